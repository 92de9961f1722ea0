import gzip

import numpy as np
import pytest

from vioapr.errors import FormatError
from vioapr.formats.stated_sigmas import path_beside, read_sigmas
from vioapr.trajectory import Trajectory

HEADER = "timestamp_s,sigma_position_m,sigma_orientation_deg\n"
TIMES = np.array([1.0, 1.5, 2.0])
PREDICTIONS = Trajectory(TIMES, np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)))


@pytest.fixture
def table(tmp_path):
    def write(text):
        path = tmp_path / "apr_net.sigma.csv"
        path.write_text(text)
        return path

    return write


def test_rows_go_to_their_predictions_and_the_others_are_unknown(table):
    sigmas = read_sigmas(table(HEADER + "2.0004,0.3,nan\n1.0,0.1,2\n"), PREDICTIONS)
    np.testing.assert_array_equal(sigmas.position_m, [0.1, np.nan, 0.3])
    np.testing.assert_array_equal(sigmas.orientation_deg, [2, np.nan, np.nan])


def test_other_columns_and_another_order_are_allowed(table):
    text = "sigma_orientation_deg,note,timestamp_s,sigma_position_m\n2,x,1.5,0.1\n"
    sigmas = read_sigmas(table(text), PREDICTIONS)
    assert (sigmas.position_m[1], sigmas.orientation_deg[1]) == (0.1, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a header with timestamp_s,.*the file is empty"),
        ("time,m,deg\n1,2,3\n", "csv:1: expected a header with the columns timestamp_s, sigma_"),
        (HEADER, "expected rows of timestamp_s,"),
        (HEADER + "1,2\n", "csv:2: expected 3 columns"),
        (HEADER + "1,x,2\n", "csv:2: expected a number, got 'x'"),
        (HEADER + "1,1,1\n2,-0.1,2\n", "csv:3: expected a sigma_position_m .* got -0.1"),
        (HEADER + "1,1,inf\n", "csv:2: expected a sigma_orientation_deg .* got inf"),
        (HEADER + "nan,1,1\n", "csv:2: expected a finite timestamp_s, got nan"),
        (HEADER + "1.2,1,1\n", "csv:2: expected the time of a prediction, got 1.200000 s: .*1.0"),
        (HEADER + "1,1,1\n1,2,2\n", "csv:3: expected one row a prediction, got 1.000000 s again"),
    ],
)
def test_bad_tables_are_refused(table, text, message):
    with pytest.raises(FormatError, match=message):
        read_sigmas(table(text), PREDICTIONS)


def test_predictions_need_a_clock(table):
    untimed = Trajectory(
        np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)), ("a", "b", "c"), False
    )
    with pytest.raises(FormatError, match="expected predictions with timestamps"):
        read_sigmas(table(HEADER + "1,1,1\n"), untimed)


def test_the_table_is_found_beside_the_predictions(tmp_path):
    assert path_beside(tmp_path / "apr_net.tum") is None
    path = tmp_path / "apr_net.sigma.csv"
    path.write_text(HEADER)
    assert path_beside(tmp_path / "apr_net.tum") == path_beside(tmp_path / "apr_net.tum.gz") == path
    path.unlink()
    packed = tmp_path / "apr_net.sigma.csv.gz"
    packed.write_bytes(gzip.compress((HEADER + "1,1,1\n").encode()))
    assert path_beside(tmp_path / "apr_net.tum") == packed
    assert read_sigmas(packed, PREDICTIONS).position_m[0] == 1
