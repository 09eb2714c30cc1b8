"""The interpretation tree (Ikeuchi 1987, sec. 2): how it is made, what it is, and how a region goes down it.

Made: `dome`, `groups`, `appearances`, `branches`, `draws`, `choice`, `joining`, `forest`. Kept: `tree`, `tree_file`.
Gone down: `root`, `classify`, `determine`.
"""
