"""One private PyBullet physics server."""

import functools

import pybullet


class BulletClient:
    """A direct (headless, in-process) connection whose calls carry its id; several live side by side.

    Unlike the one in pybullet_utils it passes no options on connecting, since PyBullet then prints to standard output,
    which belongs to the results of the commands.
    """

    def __init__(self):
        self._id = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str):
        call = functools.partial(getattr(pybullet, name), physicsClientId=self._id)
        setattr(self, name, call)  # the next access finds it at once
        return call

    def close(self) -> None:
        """Disconnect; may be called again."""
        if self._id >= 0:
            pybullet.disconnect(physicsClientId=self._id)
            self._id = -1

    def __del__(self):
        # at interpreter shutdown the module may be gone before its clients
        if pybullet is not None and getattr(self, "_id", -1) >= 0:
            self.close()
