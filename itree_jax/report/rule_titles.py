"""What each rule compares, in the paper's words (Ikeuchi 1987, sec. 2.1.4 and 2.2.1)."""

RULE_TITLES = {
    "L1": "original face inertia",
    "L2": "original face shape",
    "L3": "extended Gaussian image",
    "L4": "surface characteristic distribution",
    "L5": "edge distribution",
    "L6": "region distribution",
    "L7": "edge against surface characteristic",
    "A1": "EGI mass centre",
    "A2": "extended Gaussian image",
    "A3": "region distribution",
    "A4": "inertia direction",
    "A5": "rotation of the original face shape",
    "A6": "surface characteristic distribution",
    "A7": "edges",
    "A8": "edges against surface characteristics",
    "refinement": "all candidates left are refined and verified",
    "pruned": "one side holds only pruned groups: nothing to decide",
}


def rule_title(rule: str) -> str:
    """Empty for a rule that is not known."""
    return RULE_TITLES.get(rule, "")
