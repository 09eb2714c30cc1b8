"""What each rule compares, in the words of the rule families (Ikeuchi 1987, sec. 2.1.4 and 2.2.1)."""

from itree_jax.tree.classification_rules import CLASSIFICATION_RULES, PAIR
from itree_jax.tree.determination_family import DETERMINATION_RULES

RULE_TITLES = {rule.name: rule.title for rule in (*CLASSIFICATION_RULES, *DETERMINATION_RULES)} | {
    "refinement": "all candidates left are refined and verified",
    "verification": "the rendered pose against the scene",
    "pruned": "one side holds only pruned groups: nothing to decide",
}


def rule_title(rule: str) -> str:
    """Of a pair of rules both titles; empty for a rule that is not known."""
    return " and ".join(title for name in rule.split(PAIR) if (title := RULE_TITLES.get(name, "")))
