"""What a picture shows: keypoints, the network that detects them, and the effects of cameras."""
