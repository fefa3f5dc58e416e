"""PyTorch in one thread, for tests of fields that are its modules."""

import pytest


@pytest.fixture
def one_thread():
    """On busy machines PyTorch's threads wait for each other."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
