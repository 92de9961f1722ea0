import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.export.portable import PortableFunctions, cholesky  # noqa: E402


def test_cholesky_of_a_small_matrix():
    matrix = torch.tensor([[4.0, 2.0], [2.0, 5.0]])
    assert torch.equal(cholesky(matrix), torch.tensor([[2.0, 0.0], [1.0, 2.0]]))


def test_cholesky_equals_pytorchs():
    torch.manual_seed(0)
    factor = torch.randn(2, 6, 35, 35, dtype=torch.float64)
    matrix = factor @ factor.transpose(-1, -2) + 35 * torch.eye(35, dtype=torch.float64)
    torch.testing.assert_close(cholesky(matrix), torch.linalg.cholesky(matrix))


def test_what_is_replaced_gives_the_same_numbers():
    torch.manual_seed(0)
    values, mask, other = torch.randn(3, 7), torch.randn(3, 7) > 0, torch.randn(3, 7) > 0
    matrix = torch.randn(2, 4, 4)
    expected = [
        torch.sort(values)[0],
        torch.where(mask, values, -values),
        torch.where(mask, other, ~other),
        torch.linalg.diagonal(matrix),
    ]
    with PortableFunctions():
        found = [
            torch.sort(values)[0],
            torch.where(mask, values, -values),
            torch.where(mask, other, ~other),
            torch.linalg.diagonal(matrix),
        ]
    for left, right in zip(found, expected, strict=True):
        assert torch.equal(left, right)
