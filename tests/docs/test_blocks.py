"""What counts as the same output."""

import pytest

from .blocks import blocks_of, commands_of, differs, shell_lines


@pytest.mark.parametrize(("shown", "printed"), [
    ("a 1.00 b", "a 1.02 b"),
    ("0.98 | 2\n...", "0.99 | 2\nmore\nand more"),
    ("...\nlast", "first\nlast"),
    ("done; 28 s. Look", "done; 7.5 s. Look"),
    ("keys [...]", "keys ['a', 'b']"),
    ("┃ 0.98 │ 73.8 │", "┃ 0.98  │ 5.1   │"),
    ("└──────┘", "└─────┘"),
])  # fmt: skip
def test_alike(shown, printed):
    assert differs(shown, printed) == ""


@pytest.mark.parametrize(("shown", "printed"), [
    ("a 1.00 b", "a 2.00 b"),
    ("a 1.00 b", "a 1.00 c"),
    ("a", "a\nb"),
    ("a\nb", "a"),
    ("a\n...\nc", "a\nb"),
    ("3 found", "-3 found"),
    ("", "words"),
])  # fmt: skip
def test_not_alike(shown, printed):
    assert differs(shown, printed) != ""


def test_blocks_commands_and_reasons(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("""# Title
*Not run by the tests: no lamp.*

```sh
itree a  # why
itree b \\
  -c
```

1. Indented:

   ```console
   $ itree a \\
   > -b
   out
   $ itree c
   ```
""")
    first, second = blocks_of(page)
    assert (first.language, first.not_run, first.line) == ("sh", "no lamp.", 4)
    assert shell_lines(first.text) == ["itree a", "itree b    -c"]
    assert (second.language, second.not_run) == ("console", "")
    assert commands_of(second.text) == [("itree a > -b", "out"), ("itree c", "")]
