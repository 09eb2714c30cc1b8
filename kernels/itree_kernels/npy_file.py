"""Arrays in NumPy's file format, from bytes that anybody may have written."""

import io

import numpy as np
from jaxtyping import Shaped

from itree_kernels.errors import ItreeError


def parse_npy(content: bytes, where: str) -> Shaped[np.ndarray, "..."]:
    """The array of a .npy file's content; pickled objects are refused. Raises ItreeError; `where` names the file."""
    try:
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    except Exception as error:  # NumPy's reader of headers raises whatever it trips over, and memory may not suffice
        raise ItreeError(f"{where}: cannot be read as an array of NumPy ({error})") from error
