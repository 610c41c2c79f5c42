"""The rig in a browser: a server that shows a live node or a recording."""
