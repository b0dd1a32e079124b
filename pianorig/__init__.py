"""The command line ``pianorig``: composes model, rig, vision and validation; holds no science of its own."""
