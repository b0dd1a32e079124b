"""The bodies to track: outlines drawn on the reference, their file, pixel masks, and which body hides which."""
