"""Readers given what nobody would write: whatever they raise must be an `ItreeError`.

| module | what it is |
|---|---|
| `seeds` | small files of every kind, as the project writes them |
| `mutations` | other files made from them, that keep enough form to get past the first check |
| `targets` | readers by name: bytes -> what the reader raised |
| `guided` | one target under a coverage-guided fuzzer (extra `fuzz`), in a process of its own |

`experiments/fuzz_readers.py` runs all targets and prints a table, `experiments/fuzz_doors.py` runs the property tests
of `tests/doors` with many examples.
"""
