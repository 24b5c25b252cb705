"""Opens results in ParaView: python3 in_paraview.py FOLDER, where ParaView is (make test-paraview).

Every folder in FOLDER that has a paraview.py is shown by it, from another place than where it was
written; the picture must have a deformed body to the left, and contact surfaces to the right.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader

BACKGROUND = np.array([84, 89, 109])


def pixels(file):
    reader = vtkPNGReader()
    reader.SetFileName(str(file))
    reader.Update()
    image = reader.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)[::-1, :, :3]


def seen(part):
    """Share of a view that is not background, and its number of colours."""
    part = part[:, : int(0.8 * part.shape[1])].astype(int)  # without the colour bar
    coloured = np.abs(part - BACKGROUND).max(axis=2) > 20
    return coloured.mean(), len(np.unique(part[coloured], axis=0))


def check(folder, picture):
    script = folder / "paraview.py"
    run = subprocess.run(
        ["pvbatch", script, picture], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    assert not run.stderr.strip(), run.stderr
    image = pixels(picture)
    left, right = np.array_split(image, 2, axis=1)
    (body, colours), (pressure, shades), (status, _) = map(seen, (left, *np.array_split(right, 2)))
    print(f"{folder.name}: body {body:.2f}, {colours} colours; contact {pressure:.3f} {status:.3f}")
    assert body > 0.2
    assert colours > 100
    assert min(pressure, status) > 0.002
    assert shades > 10


def main():
    folders = sorted(p.parent for p in Path(sys.argv[1]).glob("*/paraview.py"))
    assert len(folders) == 11, folders
    for folder in folders:
        with tempfile.TemporaryDirectory() as place:
            moved = shutil.copytree(folder, Path(place) / folder.name)
            check(moved, folder.with_suffix(".png"))


main()
