"""What a scene is made of, each written once: bodies, contacts and their laws, springs, drives, joints, strings."""
