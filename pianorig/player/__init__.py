"""The moving action in a browser: its data, and the player that the page and exported animations share."""
