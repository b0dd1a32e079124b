"""Storage: files written whole or not at all, hashes, and what differs between operating systems.

In: bytes and text from every other folder of the rig.
Out: complete files; failures of the file system as :class:`rig.errors.RigInputError`.
"""
