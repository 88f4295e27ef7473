"""The web server of the page: bound to one address, and used by no other page that a browser has open."""

import threading
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

LOCALHOST, PORT = "127.0.0.1", 8080
LOOPBACK = ("127.0.0.1", "localhost", "::1")
CAMERA_AT, LOOKS_AT = (1.7, -1.3, 1.2), (0.45, 0.05, 0.15)  # m
FIELD_OF_VIEW = 0.9  # rad, of the height
AMBIENT = 1.2  # intensity of the light without direction
_opening = threading.Lock()


def open_server(host: str = LOCALHOST, port: int = PORT) -> viser.ViserServer:
    """Open the server; where the port is taken, the next free one is used.

    Args:
        host: address of this machine; other machines reach the page only if it is not a loopback address.
        port: 0: any free one.
    """
    plain = websockets.asyncio.server.serve

    def serve(*args: Any, process_request: Callable[..., Response | None], **options: Any) -> Any:
        return plain(*args, process_request=same_origin(process_request, host in LOOPBACK), **options)

    with _opening:  # viser has no option for this
        websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
        try:
            server = viser.ViserServer(host=host, port=port, label="hmap", verbose=False)
        finally:
            websockets.asyncio.server.serve = plain  # type: ignore[misc]
    server.gui.configure_theme(control_layout="fixed", control_width="large", show_logo=False, show_share_button=False)
    server.scene.set_up_direction("+z")
    server.scene.configure_environment_map(hdri=None)  # and no shadows: browsers without a GPU draw this, too
    server.scene.configure_default_lights(enabled=True, cast_shadow=False)
    server.scene.add_light_ambient("/light", color=(255, 255, 255), intensity=AMBIENT)
    server.initial_camera.position = CAMERA_AT
    server.initial_camera.look_at = LOOKS_AT
    server.initial_camera.fov = FIELD_OF_VIEW
    return server


def same_origin(
    answer: Callable[[ServerConnection, Request], Response | None], loopback: bool
) -> Callable[[ServerConnection, Request], Response | None]:
    """Refuses requests of pages that come from elsewhere: they could press the buttons that move robots.

    Args:
        answer: to all other requests.
        loopback: whether the server is bound to a loopback address; then a name that points there is refused, too.
    """

    def checked(connection: ServerConnection, request: Request) -> Response | None:
        own, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        foreign = origin is not None and urlsplit(origin).netloc != own
        if foreign or (loopback and urlsplit(f"//{own}").hostname not in LOOPBACK):
            return connection.respond(HTTPStatus.FORBIDDEN, "this page is used only from its own address\n")
        return answer(connection, request)

    return checked


def address(server: viser.ViserServer) -> str:
    """The address of the page, for a browser."""
    host = server.get_host()
    return f"http://{LOCALHOST if host in ('0.0.0.0', '::') else host}:{server.get_port()}"
