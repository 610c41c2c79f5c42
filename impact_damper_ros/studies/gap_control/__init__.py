"""What the laws of the gap control do, measured and drawn."""
