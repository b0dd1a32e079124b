"""Symbolic expression graphs, programs of them, and their lowering to machine code.

`expressions` are made once, shared, differentiated by rule; `programs` are lists of what is to be done with them;
`native` writes a program as LLVM's intermediate code, for one run or for members side by side in lanes.
"""
