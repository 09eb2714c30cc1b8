"""Numbers of the command line that no later check would explain."""

from itree_kernels.errors import ItreeError


def check_seed(seed: int) -> None:
    """Raises ItreeError unless random numbers can be drawn from it."""
    if seed < 0:
        raise ItreeError(f"--seed must be 0 or more, it is {seed}")


def check_object_number(obj_id: int | None) -> None:
    """Raises ItreeError unless results can tell objects by it."""
    if obj_id is not None and obj_id < 0:
        raise ItreeError(f"--obj-id must be 0 or more, it is {obj_id}")
