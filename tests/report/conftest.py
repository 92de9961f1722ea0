"""The walks of the tests of evaluation, for those of what it reports."""

from tests.evaluation.conftest import walks_dir  # noqa: F401  (a fixture)
