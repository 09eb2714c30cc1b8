"""The `itree` command. One file per verb; `main.main` runs one. Heavy imports wait until a verb needs them."""
