"""Numbers that are not known yet, and machine code for what is done with them.

`expressions` are made once, shared, differentiated by rule; `programs` are lists of what is to be done with them;
`native` writes a program as LLVM's intermediate code, for one run or for members side by side in lanes.
"""
