"""Builds wheel and sdist, and tries the wheel in a new environment, away from the checkout.

    python experiments/release/check_wheel.py [--python PYTHON] [--keep DIR] [--out DIR] [--quick]

The sdist must build the same wheel, byte for byte; the wheel must hold every file of the packages and nothing else; in
an environment that has nothing but the wheel and what it requires, the version must be that of pyproject.toml and of
the changelog, the schemas and bundled data must be there, and `itree demo` must find the bin's parts (`--quick` leaves
it out). `--python` names another interpreter. `--out` keeps the two files.
"""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from environment import Environment, folder

ROOT = Path(__file__).parents[2]
PACKAGES = {"itree_jax": "itree_jax", "itree_kernels": "kernels/itree_kernels", "itree_cad": "cad/itree_cad"}
BUILDER = "build>=1.2"
TRY = """
import itree_jax, json, pathlib
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_jax.grasp.gripper import load_gripper
from itree_jax.sensing.bundled import BUNDLED_SENSORS, bundled_sensor
root = pathlib.Path(itree_jax.__file__).parent
assert "site-packages" in str(root), root
sensors = [bundled_sensor(name).light_count for name in BUNDLED_SENSORS]
print(sorted(str(p.relative_to(root)) for p in root.rglob("*.schema.json") if json.loads(p.read_text())))
print([bundled_part(name).name for name in BUNDLED_PARTS], "parts, sensors of", sensors, "lights")
print([load_gripper(f"bundled:{name}").name for name in ("jaw", "cup")])
print([name for name in itree_jax.__all__ if getattr(itree_jax, name) is None])
"""


@dataclass(frozen=True)
class Config:
    python: str | None = None
    """Interpreter of the new environment; this one if none is named."""
    keep: Path | None = None
    """Folder for the environments; without it they are temporary."""
    out: Path | None = None
    """Folder for wheel and sdist."""
    quick: bool = False
    """Without the demo."""


def main(config: Config) -> None:
    """Ends with a message when something is not as it should be."""
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    check_changelog(told)
    with folder(config.keep) as place:
        wheel, sdist = build(place)
        print(f"{sdist.name} builds {wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB")
        check_content(wheel)
        environment = Environment.new(place / "wheel", config.python)
        environment.install(wheel)
        try_it(environment, place, told)
        if not config.quick:
            try_demo(environment, place)
        if config.out is not None:
            config.out.mkdir(parents=True, exist_ok=True)
            for file in (wheel, sdist):
                shutil.copy(file, config.out)


def check_changelog(version: str) -> None:
    """The newest entry is of this version."""
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    heads = [line for line in lines if line.startswith("## ")]
    newest = heads[0].removeprefix("## ").split(",")[0].strip()
    expect(newest == version, f"pyproject.toml says version {version}, the changelog's newest entry is {newest}")


def build(place: Path) -> tuple[Path, Path]:
    """The wheel that the sdist builds, and the sdist; the wheel that the checkout builds must be the same file."""
    builder = Environment.new(place / "builder")
    builder.install(BUILDER)
    made, again = place / "from_checkout", place / "from_sdist"
    for old in (made, again):
        shutil.rmtree(old, ignore_errors=True)
    builder.run("python", "-m", "build", "--sdist", "--wheel", "--outdir", made, ROOT, cwd=place)
    (sdist,) = made.glob("*.tar.gz")
    (direct,) = made.glob("*.whl")
    builder.run("python", "-m", "pip", "wheel", "--no-deps", "--wheel-dir", again, sdist, cwd=place)
    (wheel,) = again.glob("*.whl")
    expect(wheel.name == direct.name, f"the sdist builds {wheel.name}, the checkout {direct.name}")
    expect(wheel.read_bytes() == direct.read_bytes(), "the sdist builds another wheel than the checkout")
    return wheel, sdist


def check_content(wheel: Path) -> None:
    """Every tracked file of the packages is in the wheel, and nothing but them and the metadata."""
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    expected = set()
    for package, source in PACKAGES.items():
        listed = subprocess.run(
            ["git", "ls-files", "--cached", "--others", "--exclude-standard", source], cwd=ROOT, check=True,
            capture_output=True, text=True,
        )  # fmt: skip
        expected |= {package + name.removeprefix(source) for name in listed.stdout.split()}
    expect(held == expected, f"wheel and packages differ in {sorted(held ^ expected)}")


def try_it(environment: Environment, place: Path, version: str) -> None:
    """The version, every public name, schemas and bundled data."""
    said = environment.run("itree", "--version", cwd=place).stdout.strip()
    expect(said == f"itree-jax {version}", f"itree --version says '{said}', pyproject.toml {version}")
    there, parts, grippers, missing = environment.run("python", "-c", TRY, cwd=place).stdout.splitlines()
    schemas = sorted(p.relative_to(ROOT / "itree_jax").as_posix() for p in (ROOT / "itree_jax").rglob("*.schema.json"))
    expect(there == str(schemas), f"schemas in the wheel: {there}, in the checkout {schemas}")
    expect(missing == "[]", f"public names without an object: {missing}")
    python = environment.run("python", "--version", cwd=place).stdout.strip()
    print(f"{python}: {said}; {len(schemas)} schemas; {parts}; {grippers}")


def try_demo(environment: Environment, place: Path) -> None:
    ran = environment.run("itree", "demo", "-o", place / "demo", cwd=place)
    print(ran.stdout)
    for name in ("index.html", "tree.html", "results.csv", "results.json", "scene"):
        expect((place / "demo" / name).exists(), f"the demo did not write {name}")
    expect("found, 0 of" in " ".join(ran.stdout.split()), "the demo found wrong poses")


def expect(holds: bool, message: str) -> None:
    if not holds:
        sys.exit(f"check_wheel: {message}")


if __name__ == "__main__":
    main(tyro.cli(Config))
