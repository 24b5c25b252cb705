# SPDX-License-Identifier: LGPL-3.0-or-later
"""Show the results in the folder of this script in ParaView.

    paraview --script=FOLDER/paraview.py
    pvbatch FOLDER/paraview.py PICTURE.png

The left view shows the deformed body, coloured by the von Mises stress, or by the displacement if
there is no stress. The right views show the contact surfaces, coloured by pressure and status. The
files written last are shown. Files that end in .bp require the reader ADIOS2VTXReader; ParaView's
default choice cannot read them.
"""

import os
import sys
from typing import Any

FOLDER = ""  # change it if the folder was moved: paraview --script does not pass the path
FILES: dict[str, str] = {}

if "__file__" in globals():
    FOLDER = os.path.dirname(os.path.abspath(__file__))

# This script has the same name as the module that it imports.
sys.path[:] = [p for p in sys.path if not os.path.isfile(os.path.join(p or ".", "paraview.py"))]

from paraview import simple  # noqa: E402

STATUSES = ["0", "open", "1", "stick", "2", "slip", "3", "clamped"]
COLOURS = [0.79, 0.82, 0.86, 0.18, 0.43, 0.71, 0.91, 0.54, 0.17, 0.33, 0.33, 0.33]


def deformed(part: str) -> Any:
    """Open the file with the key ``part`` in `FILES` and warp its mesh by the displacement."""
    path = os.path.join(FOLDER, FILES[part])
    if path.endswith(".bp"):
        reader = simple.MergeBlocks(Input=simple.ADIOS2VTXReader(FileName=path))
    else:
        reader = simple.PVDReader(FileName=path)
    warp = simple.WarpByVector(registrationName=part, Input=reader)
    warp.Vectors = ["POINTS", "displacement"]
    warp.UpdatePipeline()
    return warp


def show(warp: Any, view: Any, array: str) -> None:
    """Show a mesh coloured by an array: a plane mesh from the front, others obliquely."""
    display = simple.Show(warp, view)
    display.LineWidth = 6.0  # of the contact surface of a 2D body
    display.NonlinearSubdivisionLevel = 2  # cells of degree 2 are curved
    simple.ColorBy(display, ("POINTS", array))
    display.SetScalarBarVisibility(view, True)
    if array == "status":
        # Statuses are categories and must not be interpolated.
        display.InterpolateScalarsBeforeMapping = display.NonlinearSubdivisionLevel = 0
        colours = simple.GetColorTransferFunction(array)
        colours.InterpretValuesAsCategories = 1
        colours.Annotations = STATUSES
        colours.IndexedColors = COLOURS
    else:
        display.RescaleTransferFunctionToDataRangeOverTime()
    *_, low, high = warp.GetDataInformation().GetBounds()
    if high > low:
        view.CameraFocalPoint = (0.0, 0.0, 0.0)
        view.CameraPosition = (1.0, -1.7, 0.9)
        view.CameraViewUp = (0.0, 0.0, 1.0)


def main() -> None:
    """Show the deformed body and its contact surfaces in three views."""
    left = simple.GetActiveViewOrCreate("RenderView")
    layout = simple.GetLayout(left)
    if "body_stress" in FILES:
        show(deformed("body_stress"), left, "von_mises")
    else:
        show(deformed("body"), left, "displacement")
    contacts = [deformed(part) for part in FILES if part.startswith("contact")]
    right = layout.SplitHorizontal(layout.GetViewLocation(left), 0.5) + 1
    above = layout.SplitVertical(right, 0.5)
    for array, cell in (("pressure", above), ("status", above + 1)):
        view = simple.CreateView("RenderView")
        simple.AssignViewToLayout(view=view, layout=layout, hint=cell)
        for warp in contacts:
            show(warp, view, array)
    simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    simple.GetAnimationScene().GoToLast()
    for view in simple.GetRenderViews():
        simple.ResetCamera(view)
    simple.RenderAllViews()
    for picture in sys.argv[1:]:
        if picture.endswith(".png"):
            layout.SetSize(1600, 900)
            simple.SaveScreenshot(picture, layout, ImageResolution=[1600, 900])


main()
