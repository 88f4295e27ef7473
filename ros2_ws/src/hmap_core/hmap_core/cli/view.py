"""``hmap view FILE``: opens a plan or a recorded bag in the browser, or writes it as one HTML file."""

import argparse
import sys
import threading
import webbrowser
from importlib.metadata import entry_points
from pathlib import Path

from hmap_core.cli.main import port_number
from hmap_core.cli.plan import check_writable
from hmap_core.exceptions import InputError

HELP = "show a plan or a recorded bag in the browser, or write it as one HTML file"
READERS = "hmap.recordings"  # group of entry points: functions that read a bag, path -> Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap view``."""
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="plan files (.json), or bags (folders)")
    parser.add_argument("--html", type=Path, metavar="HTML", help="write one file that plays offline, and end")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="of this machine (127.0.0.1)")
    parser.add_argument("--port", type=port_number, default=8080, metavar="N", help="the next free one from it (8080)")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap view``; its exit code.

    Raises:
        InputError: a file cannot be read or written.
    """
    if arguments.html is not None:
        check_writable(arguments.html)
        if len(arguments.files) > 1:
            raise InputError(f"--html writes one plan or bag; {len(arguments.files)} are given")
    recordings = [read(path) for path in arguments.files]
    if arguments.html is not None:
        from hmap_core.viewer.html_file import write_html  # slow to import, and not needed to refuse a file

        write_html(recordings[0], arguments.html)
        print(arguments.html)
        return 0
    from hmap_core.viewer.page import Page
    from hmap_core.viewer.server import address, open_server

    page = Page(open_server(arguments.host, arguments.port))
    try:
        for recording in reversed(recordings):
            page.add_recording(recording)
        print(address(page.server), flush=True)
        if not arguments.no_browser:
            webbrowser.open(address(page.server))
        print("Ctrl-C ends it", file=sys.stderr, flush=True)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        page.close()
    return 0


def read(path: Path):
    """A plan file or a bag as a :class:`hmap_core.viewer.recording.Recording`.

    Raises:
        InputError: there is no such file; it holds no plan or run.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir() or path.suffix == ".mcap":
        readers = list(entry_points(group=READERS))
        if not readers:
            raise InputError(f"{path} is a bag; bags are read by the package hmap, which is not installed")
        return readers[0].load()(path)
    from hmap_core import plan_file  # slow to import, and not needed to refuse a path
    from hmap_core.viewer.recording import of_plan

    return of_plan(plan_file.load(path), path.name)
