"""Profiles that reproduce a recorded force, by iterative learning control; force in N, positive downwards."""
