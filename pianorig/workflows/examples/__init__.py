"""Small files to try the commands with: tables of force and motion, a felt, films, a rig, a recording to import.

In: a folder to write into. Out: files that the commands of README and documentation name, computed by the model and the
virtual camera with fixed seeds; none was measured.
"""
