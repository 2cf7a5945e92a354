"""What makes a camera's pictures: lenses, backgrounds, several views."""
