"""How well bins were recognised: how far scores can be believed, groups taken for others, and every failure."""
