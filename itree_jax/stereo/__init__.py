"""Dual photometric stereo: two cameras, needle maps on both, depth from what the two see alike (Ikeuchi 1987, 3.1)."""
