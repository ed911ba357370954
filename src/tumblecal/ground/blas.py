"""Threads of the linear algebra."""

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


def single_blas_thread() -> AbstractContextManager:
    """For matrices of a hundred rows: threads would only wait for each other."""
    return _threads().limit(limits=1, user_api="blas")
