"""What a picture shows: keypoints, the network that detects them, and what cameras add."""
