"""Independent references for the exact simulator; nothing here imports the package."""
