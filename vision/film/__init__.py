"""Films as sequences of grey frames: readers of MRAW, AVI, other video and picture stacks; writers of MRAW and AVI."""
