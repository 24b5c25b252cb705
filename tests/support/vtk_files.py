"""Reader of VTK files, and colours of pictures."""

import numpy as np

OF_THE_READER = ("vtkGhostType", "vtkOriginalPointIds", "vtkOriginalCellIds")


def read_grid(file, time=-1):
    """The cells of all ranks in a ``.pvd`` at one of its times, without ghosts."""
    import pyvista

    reader = pyvista.get_reader(file)
    reader.set_active_time_value(reader.time_values[time])
    (read,) = reader.read()
    # VTK 9.3 crashes if it extracts cells of the arrays that its reader made.
    grid = pyvista.UnstructuredGrid(read.cells, read.celltypes, read.points)
    for source, target in ((read.point_data, grid.point_data), (read.cell_data, grid.cell_data)):
        for name in set(source) - set(OF_THE_READER):
            target[name] = np.array(source[name])
    grid = grid.extract_cells(np.flatnonzero(read.cell_data["vtkGhostType"] == 0))
    for data in (grid.point_data, grid.cell_data):
        for name in OF_THE_READER:
            data.pop(name, None)
    return grid


def number_of_colours(pixels):
    """Return the number of colours; the three channels of a pixel are packed into a number."""
    return len(np.unique(pixels.astype(np.int32) @ np.array([1, 256, 65536], np.int32)))


def von_mises(stress):
    """Von Mises stresses of stresses in rows of nine components."""
    s = stress.reshape(-1, 3, 3)
    deviator = s - np.trace(s, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
    return np.sqrt(1.5 * np.sum(deviator**2, axis=(1, 2)))
