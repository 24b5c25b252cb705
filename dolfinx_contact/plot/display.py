# SPDX-License-Identifier: LGPL-3.0-or-later
"""A display for VTK on machines without a screen."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess

from dolfinx_contact._install import optional

__all__ = ["ensure_display"]

#: Xvfb writes the number of its display to standard output. The shell waits until its standard
#: input is closed, which happens when this process ends in any way, and then ends Xvfb. Without
#: -noreset the server would restart, and refuse connections meanwhile, after its last client.
_SERVE = (
    "Xvfb -displayfd 1 -screen 0 1600x1200x24 -nolisten tcp -noreset 2>/dev/null & "
    "exec >&-; read _; kill $! 2>/dev/null"
)
_servers: list[subprocess.Popen[bytes]] = []


def ensure_display() -> None:
    """Make sure that VTK can open a window, if need be on a virtual display. Not collective.

    VTK with X11 as its only window system (Debian's) aborts the process if it cannot connect to an
    X server. Therefore the connection is tried first, and Xvfb is started if it fails. With a
    display VTK renders well inside an MPI process; earlier versions of this package rendered in a
    second process because of the abort. Other builds of VTK fall back to EGL or OSMesa.

    Raises:
        ModuleNotFoundError: if VTK is not installed.
        RuntimeError: if VTK needs an X server, and there is neither a display nor Xvfb.
    """
    optional("vtkmodules.vtkRenderingOpenGL2", "pictures")  # registers the class of windows
    window = optional("vtkmodules.vtkRenderingCore", "pictures").vtkRenderWindow()
    if window.GetClassName() != "vtkXOpenGLRenderWindow" or _connects():
        return
    number = b""
    if shutil.which("Xvfb"):
        stdin, _ = os.pipe()  # the kernel closes the other end when this process ends
        server = subprocess.Popen(
            ["sh", "-c", _SERVE], stdin=stdin, stdout=subprocess.PIPE, start_new_session=True
        )
        os.close(stdin)
        _servers.append(server)
        number = server.stdout.readline().strip() if server.stdout else b""
    if not number:
        raise RuntimeError("VTK needs a display to draw in 3D: install Xvfb, or set DISPLAY")
    os.environ["DISPLAY"] = f":{number.decode()}"


def _connects() -> bool:
    """Return True if the X server that DISPLAY names accepts connections."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    connection = x11.XOpenDisplay(None)
    if connection:
        x11.XCloseDisplay(ctypes.c_void_p(connection))
    return bool(connection)
