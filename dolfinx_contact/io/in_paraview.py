# SPDX-License-Identifier: LGPL-3.0-or-later
"""Show the results in the folder of this script in ParaView.

    paraview --script=FOLDER/paraview.py
    pvbatch FOLDER/paraview.py PICTURE.png

The left view shows the deformed body, coloured by the von Mises stress, or by the displacement if
there is no stress. The right views show the contact surfaces, coloured by pressure and status. If
the folder contains branches as well as a state, the group written last is shown. Files that end in
.bp require the reader ADIOS2VTXReader; ParaView's default choice cannot read them.
"""

import os
import sys
from typing import Any

WRITTEN_TO = ""  # original folder of this script

# This script has the same name as the module that it imports.
sys.path[:] = [p for p in sys.path if not os.path.isfile(os.path.join(p or ".", "paraview.py"))]

from paraview import simple  # noqa: E402

STATUSES = [
    ("0", "open", (0.79, 0.82, 0.86)),
    ("1", "stick", (0.18, 0.43, 0.71)),
    ("2", "slip", (0.91, 0.54, 0.17)),
    ("3", "clamped", (0.33, 0.33, 0.33)),
]


def own_folder() -> str:
    """Return the folder of this script, whose path paraview --script does not pass."""
    words = [__file__] if "__file__" in globals() else []
    if not words and os.path.isfile("/proc/self/cmdline"):
        with open("/proc/self/cmdline") as file:
            words = [word.replace("--script=", "") for word in file.read().split("\0")]
    scripts = [w for w in words if os.path.basename(w) == "paraview.py" and os.path.isfile(w)]
    return os.path.dirname(os.path.abspath(scripts[0])) if scripts else WRITTEN_TO


def found(folder: str) -> dict[str, str]:
    """Return the files of the state, branch or evolution written last, by part."""
    groups: dict[str, dict[str, str]] = {}
    for name in sorted(os.listdir(folder)):
        stem, kind = os.path.splitext(name)
        prefix, mark, part = stem.partition("body")
        if not mark:
            prefix, mark, part = stem.partition("contact")
        if kind in (".bp", ".pvd") and mark:
            groups.setdefault(prefix, {})[mark + part] = os.path.join(folder, name)
    if not groups:
        raise RuntimeError("there are no results in " + (folder or "the folder of this script"))
    return max(groups.values(), key=lambda files: max(map(os.path.getmtime, files.values())))


def deformed(path: str, part: str) -> Any:
    """Open a file, and deform its mesh by its displacement."""
    if path.endswith(".bp"):
        blocks = simple.ADIOS2VTXReader(registrationName=part + ".bp", FileName=path)
        reader = simple.MergeBlocks(registrationName=part, Input=blocks)
    else:
        reader = simple.PVDReader(registrationName=part, FileName=path)
    reader.UpdatePipeline()
    warp = simple.WarpByVector(registrationName=part + " deformed", Input=reader)
    warp.Vectors = ["POINTS", vector_of(reader)]
    warp.UpdatePipeline()
    return warp


def vector_of(source: Any) -> str:
    """Return the name of the displacement."""
    vectors = [a.GetName() for a in source.PointData.values() if a.GetNumberOfComponents() == 3]
    return "displacement" if "displacement" in vectors else vectors[0]


def show(source: Any, view: Any, array: list[str], title: str) -> None:
    """Show a source in a view, coloured by an array, with a colour bar, along its thinnest axis."""
    display = simple.Show(source, view)
    display.Representation = "Surface"
    display.LineWidth = 6.0  # of the contact surface of a 2D body
    simple.ColorBy(display, ("POINTS", *array))
    colours = simple.GetColorTransferFunction(array[0])
    if array[0] == "status":
        # Statuses are categories and must not be interpolated.
        display.InterpolateScalarsBeforeMapping = display.NonlinearSubdivisionLevel = 0
        colours.InterpretValuesAsCategories = 1
        colours.Annotations = [text for code, name, _ in STATUSES for text in (code, name)]
        colours.IndexedColors = [c for *_, colour in STATUSES for c in colour]
    else:
        display.NonlinearSubdivisionLevel = 2  # cells of degree 2 are curved
        display.RescaleTransferFunctionToDataRangeOverTime()
    display.SetScalarBarVisibility(view, True)
    bar = simple.GetScalarBar(colours, view)
    bar.Title = title
    bar.ComponentTitle = ""
    look(view, source)


def look(view: Any, source: Any) -> None:
    """Set the camera: frontal in 2D, oblique in 3D, and along the thin axis of a surface."""
    x = source.GetDataInformation().GetBounds()
    sizes = [x[1] - x[0], x[3] - x[2], x[5] - x[4]]
    thin = sizes.index(min(sizes))
    direction = [1.0, -1.7, 0.9]
    along_z = sizes[2] <= 0.1 * max(sizes)
    if sizes[2] <= 1e-9 * max(sizes):
        direction = [0.0, 0.0, 1.0]
    elif sizes[thin] <= 0.1 * max(sizes):
        along_z = thin == 2
        direction = [0.15, -0.25, 0.15]
        direction[thin] = 1.0
    view.CameraFocalPoint = (0.0, 0.0, 0.0)
    view.CameraPosition = direction
    view.CameraViewUp = (0.0, 1.0, 0.0) if along_z else (0.0, 0.0, 1.0)
    simple.ResetCamera(view)  # to the centre of the source, at a distance from which it is seen


def views_for(count: int) -> tuple[Any, list[Any]]:
    """Create a view and ``count`` views to its right, one above the other."""
    views = [simple.GetActiveViewOrCreate("RenderView")]
    layout = simple.GetLayout(views[0])
    cell = layout.GetViewLocation(views[0])
    for i in range(count):
        split = layout.SplitVertical if i else layout.SplitHorizontal
        cell = split(cell, 1.0 / (count - i + 1) if i else 0.5) + 1
        views.append(simple.CreateView("RenderView"))
        simple.AssignViewToLayout(view=views[-1], layout=layout, hint=cell)
    return layout, views


def main() -> None:
    """Show the body and its contact surfaces."""
    parts = {part: deformed(path, part) for part, path in found(own_folder()).items()}
    contacts = [warp for part, warp in parts.items() if part.startswith("contact")]
    beside = ["pressure", "status"] if contacts else []
    layout, views = views_for(len(beside))
    if "body_stress" in parts:
        show(parts["body_stress"], views[0], ["von_mises"], "von Mises stress")
    elif "body" in parts:
        body = parts["body"]
        show(body, views[0], [vector_of(body), "Magnitude"], "displacement")
    for view, array in zip(views[1:], beside, strict=True):
        for warp in contacts:
            show(warp, view, [array], f"{array} (contact)")
    simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    simple.GetAnimationScene().GoToLast()
    for view in views:
        simple.ResetCamera(view)
    simple.RenderAllViews()
    for picture in sys.argv[1:]:
        if picture.endswith(".png"):
            layout.SetSize(1600, 900)
            simple.SaveScreenshot(picture, layout, ImageResolution=[1600, 900])


main()
