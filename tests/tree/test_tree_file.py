"""Laws of the tree file: what goes in comes out, the same tree is the same bytes, and no damage passes unseen."""

import dataclasses
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Callable

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.tree.tree_file import load_tree, save_tree


def differences(a, b, where=""):
    """Names of the fields in which two values differ, bit by bit."""
    if type(a) is not type(b):
        return [where]
    if dataclasses.is_dataclass(a):
        pairs = [(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}") for f in dataclasses.fields(a)]
    elif isinstance(a, tuple):
        if len(a) != len(b):
            return [where]
        pairs = [(x, y, f"{where}.{k}") for k, (x, y) in enumerate(zip(a, b, strict=True))]
    elif isinstance(a, np.ndarray):
        same = (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        return [] if same else [where]
    else:
        return [] if a == b else [where]
    return [name for x, y, inside in pairs for name in differences(x, y, inside)]


def rewritten(content: bytes, change: Callable[[dict], None], fix_sums: bool) -> bytes:
    """The file with its members changed in place; with `fix_sums` by someone who knows the format."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    if fix_sums and "header.json" in members:
        header = json.loads(members["header.json"])
        for name in header["sha256"] or ():
            if f"{name}.npy" in members:
                header["sha256"][name] = hashlib.sha256(members[f"{name}.npy"]).hexdigest()
        members["header.json"] = json.dumps(header).encode()
        members["header.sha256"] = hashlib.sha256(members["header.json"]).hexdigest().encode()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


def with_header(change: Callable[[dict], None]) -> Callable[[dict], None]:
    def edit(members):
        header = json.loads(members["header.json"])
        change(header)
        members["header.json"] = json.dumps(header).encode()

    return edit


def with_array(name: str, array: np.ndarray, declared: bool = True) -> Callable[[dict], None]:
    """Puts another array in; with `declared` the header says so."""

    def edit(members):
        out = io.BytesIO()
        np.save(out, array)
        members[f"{name}.npy"] = out.getvalue()
        header = json.loads(members["header.json"])
        entry = header["tree"]
        for key in name.split("."):
            entry = entry[int(key)] if isinstance(entry, list) else entry[key]
        if declared:
            entry.update(dtype=array.dtype.str, shape=list(array.shape))
        members["header.json"] = json.dumps(header).encode()

    return edit


@pytest.fixture(scope="module")
def content(paper_tree_file):
    return paper_tree_file.read_bytes()


@pytest.fixture
def load_bytes(tmp_path):
    def load(data: bytes):
        path = tmp_path / "a.tree"
        path.write_bytes(data)
        return load_tree(path)

    return load


def test_what_is_saved_is_loaded_bit_by_bit(paper_tree, tmp_path):
    sensor = dataclasses.replace(
        paper_tree.sensor, region_of_interest=np.eye(480, 640, dtype=bool), distortion=(0.1, 1e-300)
    )
    axis, point = np.array([0.0, 0, 1]), np.zeros(3)
    symmetries = dataclasses.replace(paper_tree.symmetries, continuous=((axis, point), (-axis, point)))
    tree = dataclasses.replace(paper_tree, sensor=sensor, symmetries=symmetries, obj_id=7, spacing=np.inf)
    save_tree(tree, tmp_path / "a.tree")
    loaded = load_tree(tmp_path / "a.tree")
    assert differences(tree, loaded) == []
    assert differences(paper_tree, loaded) == [
        ".obj_id", ".symmetries.continuous", ".sensor.distortion", ".sensor.region_of_interest", ".spacing",
    ]  # fmt: skip


def test_the_same_tree_is_the_same_bytes(paper_tree, content, tmp_path, monkeypatch):
    monkeypatch.setattr("time.time", lambda: 2e9)
    save_tree(paper_tree, tmp_path / "a.tree")
    assert (tmp_path / "a.tree").read_bytes() == content


def test_other_programs_can_read_the_arrays_without_pickle(paper_tree, paper_tree_file):
    with np.load(paper_tree_file, allow_pickle=False) as file:
        assert np.array_equal(file["groups.labels"], paper_tree.groups.labels)
        header = json.loads(file["header.json"])
    assert header["part"]["triangles"] == len(paper_tree.part.triangles)
    assert header["sensor"]["slant_limit_deg"] == pytest.approx(42.0)


def test_saving_is_whole_or_not_at_all(paper_tree, content, tmp_path, monkeypatch):
    path = tmp_path / "a.tree"
    path.write_bytes(b"the old one")

    def full(*_):
        raise OSError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", full)
        with pytest.raises(ItreeError, match="no space left"):
            save_tree(paper_tree, path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.tree": b"the old one"}
    save_tree(paper_tree, path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.tree": content}
    with pytest.raises(ItreeError, match="cannot be written"):
        save_tree(paper_tree, tmp_path / "nowhere" / "a.tree")


@pytest.mark.parametrize("data", [b"", b"solid ascii stl", b"PK\x03\x04", b"\x93NUMPY"])
def test_what_is_no_tree_file_is_refused(data, load_bytes):
    with pytest.raises(ItreeError, match=r"is not a tree file|cut short or damaged"):
        load_bytes(data)


def test_another_zip_file_a_folder_and_no_file_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.zeros(3))
    with pytest.raises(ItreeError, match="is not a tree file"):
        load_tree(tmp_path / "a.npz")
    with pytest.raises(ItreeError, match=r"there is no tree file .*b\.tree; make one with `itree compile"):
        load_tree(tmp_path / "b.tree")
    with pytest.raises(ItreeError, match="cannot be read"):
        load_tree(tmp_path)


def test_a_truncated_file_is_refused(content, load_bytes):
    for share in (0.001, 0.3, 0.9, 0.999):
        with pytest.raises(ItreeError, match="cut short or damaged"):
            load_bytes(content[: int(share * len(content))])


def test_any_flipped_bit_is_refused_or_harmless(paper_tree, content, load_bytes):
    """Harmless: bits that zip readers don't look at, such as dates."""
    directory = content.rindex(b"PK\x05\x06")
    first_entry = int.from_bytes(content[directory + 16 : directory + 20], "little")
    rng = np.random.default_rng(0)
    inside = rng.integers(0, first_entry, 40)  # nearly all in the data of members
    listing = rng.integers(first_entry, len(content), 40)
    refused = 0
    for position in np.concatenate([np.arange(0, 40, 2), inside, listing]):
        damaged = bytearray(content)
        damaged[position] ^= 1 << int(rng.integers(8))
        try:
            assert differences(load_bytes(bytes(damaged)), paper_tree) == []
        except ItreeError:
            refused += 1
    assert refused >= 40


def test_a_changed_array_fails_its_checksum(content, load_bytes):
    error = with_array("nodes.error", np.zeros(6, np.float32))
    with pytest.raises(ItreeError, match="header was changed"):
        load_bytes(rewritten(content, error, fix_sums=False))

    def swap(members):
        members["nodes.error.npy"] = members["nodes.error.npy"][:-1] + b"\x01"

    with pytest.raises(ItreeError, match=r"the array nodes\.error was changed .* Compile the part again"):
        load_bytes(rewritten(content, swap, fix_sums=False))


def test_a_missing_array_is_named(content, load_bytes):
    with pytest.raises(ItreeError, match=r"the array appearances\.egi is missing"):
        load_bytes(rewritten(content, lambda members: members.pop("appearances.egi.npy"), fix_sums=False))

    def forget(header):
        del header["sha256"]["appearances.egi"]

    with pytest.raises(ItreeError, match=r"the array appearances\.egi is missing"):
        load_bytes(rewritten(content, with_header(forget), fix_sums=True))


def test_another_version_is_refused_with_what_to_do(content, load_bytes):
    newer = with_header(lambda header: header.update(version=99, producer="itree-jax 9.0"))
    with pytest.raises(ItreeError, match=r"version 99, written by itree-jax 9\.0; .* Upgrade itree-jax"):
        load_bytes(rewritten(content, newer, fix_sums=True))
    for version in (0, 1):
        older = with_header(lambda header, v=version: header.update(version=v, producer="itree-jax 0.1"))
        match = rf"version {version}, written by itree-jax 0\.1; this program reads version 3\. Compile the part again"
        with pytest.raises(ItreeError, match=match):
            load_bytes(rewritten(content, older, fix_sums=True))


@pytest.mark.parametrize("rubbish", [b"", b"(", b"{'descr': (", b"\x00" * 20])
def test_an_array_whose_header_is_rubbish_is_named(rubbish, content, load_bytes):
    """NumPy's reader raises what its tokenizer does."""
    def damage(members):
        members["nodes.error.npy"] = b"\x93NUMPY\x01\x00" + len(rubbish).to_bytes(2, "little") + rubbish

    with pytest.raises(ItreeError, match=r"nodes\.error\.npy is not an array"):
        load_bytes(rewritten(content, damage, fix_sums=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_array("nodes.visible", np.zeros((6, 3), bool)), r"nodes\.hidden is bool \[6, 7\], not Bool \[nodes gro"),
        (with_array("nodes.parent", np.zeros(6)), r"nodes\.parent is float64 \[6\], not Int \[nodes\]"),
        (with_array("nodes.parent", np.zeros(7, np.int32), declared=False), r"nodes\.parent is .*its entry says"),
        (with_array("groups.labels", np.array([None])), r"groups\.labels\.npy is not an array"),
        (with_header(lambda h: h.pop("tree")), "the header lacks the tree"),
        (with_header(lambda h: h.update(sha256=[])), "the header lacks the checksums"),
        (with_header(lambda h: h["tree"].pop("seed")), "seed is missing"),
        (with_header(lambda h: h["tree"].update(seed="0")), "seed is '0', not int"),
        (with_header(lambda h: h["tree"].update(spacing=None)), "spacing is None, not float"),
        (with_header(lambda h: h["tree"]["sensor"]["camera"].update(kind="x")), r"sensor\.camera\.kind is 'x'"),
        (with_header(lambda h: h["tree"]["nodes"].update(branch="B0")), r"nodes\.branch is not a list"),
        (with_header(lambda h: h["tree"].update(part=[])), "part is not an object"),
    ],
)
def test_what_does_not_fit_together_is_named(change, message, content, load_bytes):
    """Files whose checksums are right, made by another program."""
    with pytest.raises(ItreeError, match=message):
        load_bytes(rewritten(content, change, fix_sums=True))
