"""A decision path in one line a step, from the JSON of `itree recognize --json`."""

from collections.abc import Mapping, Sequence
from typing import Any

from itree_jax.report.markup import number, percent, text
from itree_jax.report.rule_titles import rule_title

Step = Mapping[str, Any]


def path_in_words(steps: Sequence[Step]) -> list[str]:
    """Each step as HTML: rule, what it decided and how sure it was, and what is left after it."""
    return [step_in_words(step) for step in steps]


def step_in_words(step: Step) -> str:
    said = step["compared_with"] if isinstance(step["compared_with"], dict) else {}
    branch = f"{text(said['branch'])}: " if "branch" in said else ""
    title = rule_title(step["rule"])
    words = [f"{branch}<b>{text(step['rule'])}</b>{f' ({text(title)})' if title else ''}"]
    if "taken" in said:
        words.append(f"{text(said['taken'])} side")
    if step["margin"] is not None:
        note = "against this rule" if "taken" in said else "a rival has more"
        against = f', <span class="chip warn">{note}</span>' if step["margin"] < 0 else ""
        words.append(f"margin {number(step['margin'], 2)} nat{against}")
    if said.get("error_rate") is not None:
        words.append(f"errs in {percent(said['error_rate'], 0)}")
    if said.get("group"):
        words.append(f"group <code>{text(said['group'])}</code>")
    if said.get("alternatives"):
        words.append(f"not told from <code>{text(', '.join(said['alternatives']))}</code>")
    if said.get("rivals"):
        rivals = ", ".join(number(r, 0) for r in said["rivals"])
        words.append(f"evidence {number(step['measured']['evidence'], 0)} against {rivals} of rivals")
    before, after = step["freedom_before"], step["freedom_after"]
    if before != after:
        words.append(f"{text(before)} → {text(after)}")
    return " · ".join(words)


def against_count(steps: Sequence[Step]) -> int:
    """Nodes of the classification part whose rule preferred the other side."""
    return sum(1 for s in steps if isinstance(s["compared_with"], dict) and "taken" in s["compared_with"]
               and s["margin"] is not None and s["margin"] < 0)  # fmt: skip
