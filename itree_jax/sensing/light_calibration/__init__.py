"""Lights from photographs of spheres, mirrors or matte ones; `calibrate` tells the story."""
