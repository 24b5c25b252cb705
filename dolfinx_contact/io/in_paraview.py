# SPDX-License-Identifier: LGPL-3.0-or-later
"""Show the results beside this script in ParaView.

    paraview --script=FOLDER/paraview.py
    pvbatch FOLDER/paraview.py PICTURE.png

The left view shows the deformed body, coloured by the von Mises stress, or by the displacement if
there is no stress. The right views show the contact surfaces, coloured by pressure and status. For
a pair of bodies these are on the slave; the view below shows the pressure on the master, from the
file that ends in _opposite. If the folder contains branches as well as a state, the group written
last is shown, and the others are available in the pipeline browser. Files that end in .bp require
the reader ADIOS2VTXReader; ParaView's default choice cannot read them.
"""

import os
import sys
from typing import Any

WRITTEN_TO = ""  # original folder of this script, if ParaView does not pass its path


def own_folder() -> str:
    """Return the folder of this script, which contains the results."""
    if "__file__" in globals():
        return os.path.dirname(os.path.abspath(__file__))
    try:  # paraview --script does not pass it
        with open("/proc/self/cmdline") as file:
            words = file.read().split("\0")
    except OSError:
        words = []
    for i, word in enumerate(words[:-1]):
        script = words[i + 1] if word == "--script" else word.partition("--script=")[2]
        if os.path.isfile(script):
            return os.path.dirname(os.path.abspath(script))
    return WRITTEN_TO


# This script has the same name as the module that it imports.
sys.path[:] = [p for p in sys.path if not os.path.isfile(os.path.join(p or ".", "paraview.py"))]

from paraview import simple  # noqa: E402

STATUSES = [
    ("0", "open", (0.79, 0.82, 0.86)),
    ("1", "stick", (0.18, 0.43, 0.71)),
    ("2", "slip", (0.91, 0.54, 0.17)),
    ("3", "clamped", (0.33, 0.33, 0.33)),
]
RANGES: dict[str, tuple[float, float]] = {}  # colour range of each array


def found(folder: str) -> list[tuple[str, dict[str, str]]]:
    """Return prefix and files by part of each group, the latest group last.

    A group is a state (prefix ""), a branch or an evolution.
    """
    groups: dict[str, dict[str, str]] = {}
    for name in sorted(os.listdir(folder)):
        stem, kind = os.path.splitext(name)
        if kind not in (".bp", ".pvd"):
            continue
        prefix = stem[:12] if stem.startswith("branch_") else ""
        prefix = "evolution_" if stem.startswith("evolution_") else prefix
        part = stem[len(prefix) :]
        if part in ("body", "body_stress") or part.startswith("contact"):
            files = groups.setdefault(prefix, {})
            path = os.path.join(folder, name)
            if part not in files or os.path.getmtime(files[part]) < os.path.getmtime(path):
                files[part] = path  # the later of two formats
    return sorted(groups.items(), key=lambda g: max(map(os.path.getmtime, g[1].values())))


def opened(path: str, name: str) -> Any:
    """Open a file with a reader that has this name in the pipeline browser."""
    if path.endswith(".bp"):
        parts = simple.ADIOS2VTXReader(registrationName=name + ".bp", FileName=path)
        reader = simple.MergeBlocks(registrationName=name, Input=parts)
    else:
        reader = simple.PVDReader(registrationName=name, FileName=path)
    reader.UpdatePipeline()
    return reader


def warped(reader: Any, name: str) -> tuple[Any, str]:
    """Deform a reader by its displacement; return the filter and the name of the array."""
    arrays = {a.GetName(): a.GetNumberOfComponents() for a in reader.PointData.values()}
    vectors = [a for a, components in arrays.items() if components == 3]
    vector = "displacement" if "displacement" in vectors else vectors[0]
    warp = simple.WarpByVector(registrationName=name, Input=reader)
    warp.Vectors = ["POINTS", vector]
    warp.UpdatePipeline()
    return warp, vector


def shown(source: Any, view: Any, array: list[str], title: str) -> None:
    """Show a source in a view, coloured by an array, with a colour bar."""
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
        # Views that share colours share their range.
        low, high = RANGES.get(array[0], (float("inf"), -float("inf")))
        RANGES[array[0]] = min(low, colours.RGBPoints[0]), max(high, colours.RGBPoints[-4])
        colours.RescaleTransferFunction(*RANGES[array[0]])
    display.SetScalarBarVisibility(view, True)
    bar = simple.GetScalarBar(colours, view)
    bar.Title = title
    bar.ComponentTitle = ""


def open_all(prefix: str, files: dict[str, str]) -> dict[str, tuple[Any, str]]:
    """Open and deform the files of a group; bodies come first."""
    bodies = [part for part in ("body_stress", "body") if part in files]
    contacts = [part for part in files if part.startswith("contact")]
    names = {part: prefix + part for part in bodies + contacts}
    return {p: warped(opened(files[p], name), name + " deformed") for p, name in names.items()}


def show(parts: dict[str, tuple[Any, str]]) -> tuple[Any, list[Any]]:
    """Show a group and return the layout and its views."""
    contacts = [warp for part, (warp, _) in parts.items() if part.startswith("contact")]
    # The master of a pair has no statuses.
    slaves = [warp for warp in contacts if warp.PointData.GetArray("status")]
    masters = [warp for warp in contacts if warp not in slaves]
    beside = [("pressure", "(contact)", slaves), ("status", "(contact)", slaves)] if slaves else []
    if masters:
        beside.append(("pressure", "(opposite face)", masters))
    layout, views = views_for(len(beside))
    if "body_stress" in parts:
        body, _ = parts["body_stress"]
        shown(body, views[0], ["von_mises"], "von Mises stress")
        look(views[0], body)
    elif "body" in parts:
        body, vector = parts["body"]
        shown(body, views[0], [vector, "Magnitude"], "displacement")
        look(views[0], body)
    for view, (array, where, warps) in zip(views[1:], beside, strict=True):
        for warp in warps:
            shown(warp, view, [array], f"{array} {where}")
            look(view, warp, along=True)
    return layout, views


def look(view: Any, source: Any, along: bool = False) -> None:
    """Set the camera: frontal in 2D, oblique in 3D, or along the thinnest axis if ``along``."""
    x = source.GetDataInformation().GetBounds()
    sizes = [x[1] - x[0], x[3] - x[2], x[5] - x[4]]
    thin = sizes.index(min(sizes))
    flat = sizes[2] <= 1e-9 * max(sizes)
    direction = [1.0, -1.7, 0.9]
    up = (0.0, 0.0, 1.0)
    if flat:
        direction = [0.0, 0.0, 1.0]
        up = (0.0, 1.0, 0.0)
    elif along:
        direction = [0.15, -0.25, 0.15]
        direction[thin] = 1.0
        up = (0.0, 1.0, 0.0) if thin == 2 else (0.0, 0.0, 1.0)
    middle = [(x[0] + x[1]) / 2, (x[2] + x[3]) / 2, (x[4] + x[5]) / 2]
    view.CameraFocalPoint = middle
    view.CameraViewUp = up
    view.CameraPosition = [m + 3.0 * max(sizes) * d for m, d in zip(middle, direction, strict=True)]
    simple.ResetCamera(view)


def views_for(count: int) -> tuple[Any, list[Any]]:
    """Create a view and ``count`` views to its right, one above the other."""
    views = [simple.GetActiveViewOrCreate("RenderView")]
    layout = simple.GetLayout(views[0])
    cell = layout.GetViewLocation(views[0])
    for i in range(count):
        if i == 0:
            cell = layout.SplitHorizontal(cell, 0.5) + 1
        else:
            cell = layout.SplitVertical(cell, 1.0 / (count - i + 1)) + 1
        views.append(simple.CreateView("RenderView"))
        simple.AssignViewToLayout(view=views[-1], layout=layout, hint=cell)
    return layout, views


def main() -> None:
    """Show the group that was written last; open the others."""
    folder = own_folder()
    groups = found(folder)
    if not groups:
        raise RuntimeError("there are no results in " + (folder or "the folder of this script"))
    for prefix, files in groups[:-1]:
        open_all(prefix, files)
    layout, views = show(open_all(*groups[-1]))
    simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    simple.GetAnimationScene().GoToLast()
    for view in views:
        simple.ResetCamera(view)
    simple.RenderAllViews()
    pictures = [word for word in sys.argv[1:] if word.endswith(".png")]
    if pictures:
        layout.SetSize(1600, 900)
        simple.SaveScreenshot(pictures[0], layout, ImageResolution=[1600, 900])


main()
