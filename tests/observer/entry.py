"""Functions of the kernel that have no Python wrapper of their own, made callable for tests."""

from numba import njit

from observer import kernel


def _callable(function):
    @njit
    def called(*args):
        return function(*args)

    return called


acceleration = _callable(kernel.acceleration)
transition = _callable(kernel.transition)
predict = _callable(kernel.predict)
sparse_row = _callable(kernel.sparse_row)
fuse = _callable(kernel.fuse)
move = _callable(kernel.move)
on_accelerometer = _callable(kernel.on_accelerometer)
