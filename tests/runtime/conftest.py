import pytest
from tests.localizers import eventful_walk


@pytest.fixture(scope="session")
def walk():
    return eventful_walk()
