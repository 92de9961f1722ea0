import pytest

from vioapr.cli.bench import shares_of, table_of
from vioapr.schemas.bench import BenchResult, Percentiles
from vioapr.schemas.contract import Regressor


def bench_result(**medians_ms):
    regressor = Regressor("mobile", ("a",))
    return BenchResult(
        file="x.onnx", file_mb=1.0, method="chain", precision="fp32", regressor=regressor,
        image_px=(480, 640), threads=1, machine="x", memory_mb=None, energy_j=None,
        ms={name: Percentiles(ms, ms, ms) for name, ms in medians_ms.items()},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("medians_ms", "shares"),
    [
        # What the parts leave is between them.
        ({"whole": 10, "preprocess": 1, "network": 6, "fusion": 2}, [10, 60, 20, 10]),
        # Parts that take longer alone than together are shares of their sum.
        ({"whole": 10, "preprocess": 3, "network": 12, "fusion": 5}, [15, 60, 25]),
        # Rounding leaves no percent over.
        ({"whole": 9, "preprocess": 3, "network": 3, "fusion": 3}, [34, 33, 33]),
        ({"whole": 7, "preprocess": 0.01, "network": 6.98, "fusion": 0.01}, [0, 100, 0]),
        ({"whole": 5}, []),
    ],
)
def test_shares_of_the_parts_add_up(medians_ms, shares):
    found = shares_of(bench_result(**medians_ms))
    assert found.pop("whole") == 100
    assert list(found.values()) == shares
    assert sum(shares) in (0, 100)


def test_the_table_has_a_row_for_what_is_between():
    table = table_of(bench_result(whole=10, preprocess=1, network=6, fusion=2))
    assert [row.cells for row in table.rows][-1] == ("between the parts", "–", "–", "–", "10 %")
    assert table.rows[1].values == {
        "part": "preprocess", "median_ms": 1, "p95_ms": 1, "p99_ms": 1, "share_percent": 10,
    }  # fmt: skip
