"""Films as sequences of grey frames: readers of MRAW, AVI, other video and picture stacks; writers of MRAW and AVI.

In: film files. Out: `vision.film.source.Film`, which gives frames, or regions of frames, by number, with the time of
each frame where the file states it.
"""
