"""Cases 1 to 3 of Ikeuchi 1987 (sec. 3.2-3.4) on simulated bins: what `experiments/paper_cases.py` is made of."""
