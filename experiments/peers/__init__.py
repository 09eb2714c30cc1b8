"""Peers on the same scenes: OpenCV's point pair features, Open3D's FPFH with RANSAC, both with ICP and verified.

Everything but `compare` and `wins` runs in an environment of its own (README.md) and does not import itree_jax.
"""
