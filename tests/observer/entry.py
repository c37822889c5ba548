"""Functions of the kernel that have no Python wrapper of their own, made callable for tests."""

from numba import njit

from observer import kernel


@njit
def acceleration(*args):
    return kernel.acceleration(*args)


@njit
def transition(*args):
    return kernel.transition(*args)


@njit
def predict(*args):
    return kernel.predict(*args)


@njit
def sparse_row(*args):
    return kernel.sparse_row(*args)


@njit
def fuse(*args):
    return kernel.fuse(*args)


@njit
def move(*args):
    return kernel.move(*args)


@njit
def on_accelerometer(*args):
    return kernel.on_accelerometer(*args)
