"""TCP ports that are free."""

import socket

LAST = 2**16 - 1


def free_port(host: str, first: int) -> int:
    """The first free port from a number on; any free one where the number is 0, or where none is left.

    Args:
        host: address of this machine.
        first: where to begin.
    """
    for port in (*range(first, LAST + 1), 0) if first else (0,):
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((host, port))
            except OSError:
                continue
            return int(trial.getsockname()[1])
    return first
