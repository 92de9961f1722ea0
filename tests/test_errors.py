import pickle

import pytest

from vioapr.errors import (
    DiskFullError,
    FormatError,
    MappingError,
    MissingExtraError,
    UnwritableError,
    VioAprError,
)


@pytest.mark.parametrize(
    "error",
    [
        FormatError("poses.txt", "expected 8 numbers, got 7", 3),
        UnwritableError.of("poses.txt", OSError(28, "No space left on device")),
        MissingExtraError("mapping", "pycolmap", "mapping"),
        MappingError("no map"),
    ],
)
def test_errors_pass_between_processes_as_they_are(error: VioAprError):
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert str(there) == str(error)
    assert vars(there) == vars(error)


def test_a_full_disk_has_its_own_class():
    assert isinstance(UnwritableError.of("a", OSError(28, "full")), DiskFullError)
