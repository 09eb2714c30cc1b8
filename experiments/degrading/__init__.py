"""Scenes made worse step by step: what is wrong with them, how they are imaged, how answers are counted and drawn."""
