"""Results on disk: the BOP csv, and a JSON file with the reason for every answer (`results.schema.json`)."""

import csv
import json
import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float, Int

from itree_jax.detections import Detection, Detections, Unobservable

RESULTS_VERSION = 2  # of the JSON file; raised when a reader of the old one would misread the new one
SCHEMA_PATH = Path(__file__).with_name("results.schema.json")
CSV_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
IN_DEGREES = np.repeat([np.degrees(1.0), 1.0], 3)  # of the numbers of a twist
ROTATION_TOLERANCE = 0.01  # of R R^T against I: rounding to three digits passes, a scaled or sheared matrix does not


@dataclass(frozen=True)
class BopResults:
    """The rows of a BOP csv as arrays, in the order of the file."""

    scene_id: Int[np.ndarray, "rows"]
    im_id: Int[np.ndarray, "rows"]
    obj_id: Int[np.ndarray, "rows"]
    score: Float[np.ndarray, "rows"]
    R: Float[np.ndarray, "rows 3 3"]  # model to camera
    t: Float[np.ndarray, "rows 3"]  # [mm]
    time: Float[np.ndarray, "rows"]  # [s], -1 when not measured

    def __len__(self) -> int:
        return len(self.scene_id)

    def __getitem__(self, rows: Any) -> "BopResults":
        """The rows chosen by a mask, an index array or a slice."""
        return BopResults(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


def write_bop_csv(detections: Iterable[Detections], path: str | Path) -> None:
    """Writes `scene_id,im_id,obj_id,score,R,t,time`, by scene, image and falling score. Numbers survive exactly."""
    lines = [",".join(CSV_COLUMNS)]
    for image in _by_scene(detections):
        for d in image.by_score:
            cells = (d.scene_id, d.im_id, d.obj_id, repr(float(d.score)), _numbers(d.R_cam_obj), _numbers(d.t_cam_obj),
                     repr(float(image.time)))  # fmt: skip
            lines.append(",".join(map(str, cells)))
    _write_atomically(Path(path), "\n".join(lines) + "\n")


def write_json(detections: Iterable[Detections], path: str | Path) -> None:
    """Writes everything about every answer, decision paths included, as `results.schema.json` says.

    Lengths in mm, angles in degrees. A number that is not finite is written as null.
    """
    write_json_document(results_document(detections), path)


def results_document(detections: Iterable[Detections]) -> dict[str, Any]:
    """What `write_json` writes, as plain JSON data."""
    return _plain({
        "version": RESULTS_VERSION, "units": {"length": "mm", "angle": "deg", "time": "s"},
        "images": [_image_to_json(image) for image in _by_scene(detections)],
    })  # fmt: skip


def csv_lines(document: dict[str, Any]) -> list[str]:
    """The rows of a BOP csv that say what a results document says; the numbers are those of `write_bop_csv`."""
    return [
        ",".join(map(str, (
            image["scene_id"], image["im_id"], d["obj_id"], repr(float(d["score"])), _numbers(np.array(d["R"])),
            _numbers(np.array(d["t"])), repr(float(image["time"])),
        )))
        for image in document["images"] for d in image["detections"]
    ]  # fmt: skip


def write_json_document(document: dict[str, Any], path: str | Path) -> None:
    """Writes JSON whole or not at all. A number that is not finite is written as null."""
    _write_atomically(Path(path), json.dumps(_plain(document), indent=1, allow_nan=False) + "\n")


def read_bop_csv(path: str | Path) -> BopResults:
    """Reads a BOP csv.

    Raises:
        ItreeError: naming file, row (the header is row 1) and column of what is wrong.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ItreeError(f"{path}: cannot be read as a csv file ({error}).") from error
    header = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise ItreeError(
            f"{path}: the first line lacks the column(s) {', '.join(missing)}; "
            f"a BOP results file begins with `{','.join(CSV_COLUMNS)}`."
        )
    columns = [header.index(name) for name in CSV_COLUMNS]
    records = [_parse_row(path, i, row, columns, len(header)) for i, row in enumerate(rows[1:], start=2)]
    return _stack(records)


def _parse_row(path: Path, number: int, row: list[str], columns: Sequence[int], width: int) -> tuple[Any, ...]:
    if len(row) != width:
        raise ItreeError(f"{path}, row {number}: {len(row)} cells where the first line has {width}.")
    ids = [_parse_int(path, number, name, row[columns[i]]) for i, name in enumerate(CSV_COLUMNS[:3])]
    score = _parse_floats(path, number, "score", row[columns[3]], 1)[0]
    R = _parse_floats(path, number, "R", row[columns[4]], 9).reshape(3, 3)
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise ItreeError(f"{path}, row {number}, column R: not a rotation matrix (R R^T is not I, or det R is -1).")
    t = _parse_floats(path, number, "t", row[columns[5]], 3)
    time = _parse_floats(path, number, "time", row[columns[6]], 1)[0]
    return (*ids, score, R, t, time)


def _parse_int(path: Path, number: int, column: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ItreeError(f"{path}, row {number}, column {column}: {text!r} is not a whole number.") from None


def _parse_floats(path: Path, number: int, column: str, text: str, count: int) -> Float[np.ndarray, "count"]:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise ItreeError(f"{path}, row {number}, column {column}: {text!r} is not a list of numbers.") from None
    if len(values) != count or not np.isfinite(values).all():
        raise ItreeError(
            f"{path}, row {number}, column {column}: {count} finite number(s) expected, separated by spaces: {text!r}."
        )
    return values


def _stack(records: list[tuple[Any, ...]]) -> BopResults:
    columns = list(zip(*records, strict=True)) if records else [()] * len(CSV_COLUMNS)
    ids = [np.array(c, dtype=np.int64) for c in columns[:3]]
    score, R, t, time = (np.array(c, dtype=float) for c in columns[3:])
    return BopResults(ids[0], ids[1], ids[2], score, R.reshape(-1, 3, 3), t.reshape(-1, 3), time)


def _by_scene(detections: Iterable[Detections]) -> list[Detections]:
    return sorted(detections, key=lambda image: (image.scene_id, image.im_id))


def _image_to_json(image: Detections) -> dict[str, Any]:
    return {"scene_id": image.scene_id, "im_id": image.im_id, "time": image.time,
            "detections": [_detection_to_json(d) for d in image.by_score],
            "not_recognised": list(image.not_recognised),
            **({} if image.lights is None else {"lights": image.lights})}  # fmt: skip


def _detection_to_json(d: Detection) -> dict[str, Any]:
    degrees = None if d.rotation_std is None else np.degrees(d.rotation_std)
    covariance = None if d.covariance is None else np.ravel(d.covariance * np.outer(IN_DEGREES, IN_DEGREES))
    return {
        "obj_id": d.obj_id, "score": d.score, "offer_rank": d.offer_rank, "height_mm": d.height,
        "R": np.ravel(d.R_cam_obj), "t": d.t_cam_obj, "T": np.ravel(d.T_cam_obj),
        "rotation_std_deg": degrees, "translation_std_mm": d.translation_std,
        "pixels": {"agreeing": d.agreeing, "contradicting": d.contradicting, "hidden": d.hidden},
        "covariance_deg_mm": covariance,
        "unobservable": [_unobservable_to_json(u) for u in d.unobservable],
        "equivalents": [np.ravel(T) for T in d.equivalents or ()],
        "ambiguous": d.ambiguous,
        "alternatives": [{"T": np.ravel(a.T_cam_obj), "share": a.share} for a in d.alternatives],
        "decision_path": [asdict(step) for step in d.decision_path],
    }  # fmt: skip


def _unobservable_to_json(u: Unobservable) -> dict[str, Any]:
    """The twist of a turn by 1 degree or a shift by 1 mm."""
    turns = np.linalg.norm(u.twist[:3]) > 0.5
    per_degree = np.radians(1.0) if turns else 1.0
    return {"words": u.words, "twist_deg_mm": u.twist * IN_DEGREES * per_degree, "deviation_mm": u.deviation}


def _plain(value: Any) -> Any:
    """`value` as data that JSON can hold: arrays become lists, numbers that are not finite become None."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value


def _numbers(values: Float[np.ndarray, "..."]) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _write_atomically(path: Path, text: str) -> None:
    """A reader sees the old file or the new one, never half of one."""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", text=True)
    except OSError as error:
        raise ItreeError(f"{path}: cannot be written ({error}).") from error
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        os.unlink(temporary)
        if isinstance(error, OSError):
            raise ItreeError(f"{path}: cannot be written ({error}).") from error
        raise
