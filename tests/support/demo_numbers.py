"""Verified numbers of the demos: for each, its reference and the expressions of both.

`tests/data/verified.csv` is the table of the documentation. It is written by

    docker/run env PYTHONPATH=.:tests python3 -m support.demo_numbers [NAME ...]
"""

import ast
import csv
import sys
import tempfile
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "tests" / "data" / "verified.csv"
COLUMNS = ("demo", "quantity", "reference", "exact", "ours", "error")


@dataclass(frozen=True)
class Number:
    """A number that a demo computes.

    Attributes:
        quantity: its description.
        reference: source of the reference value.
        ours: expression of the number in the namespace of the demo.
        exact: expression of the reference value; "0" for errors and residuals.
        tolerance: largest relative error, or absolute error if the reference value is 0.
    """

    quantity: str
    reference: str
    ours: str
    exact: str
    tolerance: float

    def evaluated(self, names):
        """Return our value, the reference value and the error."""
        ours, exact = (float(eval(text, dict(names))) for text in (self.ours, self.exact))
        return ours, exact, abs(ours - exact) / (abs(exact) or 1.0)


NUMBERS = {
    "block": [
        Number("normal force", "GetFEM", "normal", "reference['normal']", 1e-7),
        Number("shear force", "GetFEM", "shear", "reference['shear']", 1e-7),
    ],
    "dragged_body": [
        Number("imbalance of floor and support", "equilibrium", "imbalance", "0", 1e-10),
        Number("shear of the history", "itself, 20 steps", "-dragged[0]", "0.376738", 2e-3),
    ],
    "two_cylinders": [
        Number("contact radius, mm", "Hertz", "contact_radius", "hertz_radius", 0.03),
        Number("peak pressure, MPa", "Hertz, NAFEMS CB-1", "peak", "hertz_peak", 0.02),
        Number("force of spheres, N", "itself, refined", "force", "660.7e3", 5e-3),
        Number(
            "peak pressure of spheres, MPa",
            "Hertz at the measured force",
            "peak_of_spheres",
            "hertz_peak_of_spheres",
            3e-3,
        ),
    ],
    "ironing": [
        Number("V at t = 1, N/mm", "itself, refined", "V_pressed", "330.6", 3e-3),
        Number("H at t = 1, N/mm", "itself, refined", "H_pressed", "68.2", 0.03),
        Number("V at t = 1.1, N/mm", "itself, refined", "V_dragged", "403.9", 0.01),
        Number("H at t = 1.1, N/mm", "itself, refined", "H_dragged", "128.8", 0.03),
    ],
    "mindlin": [
        Number("error of the shear, loaded", "Cattaneo, Mindlin", "errors['loaded']", "0", 0.02),
        Number("error of the shear, unloaded", "Mindlin, Johnson", "errors['unloaded']", "0", 0.02),
    ],
    "peeling": [
        Number("P^2 D over that of a beam", "beam theory", "constant.mean()", "1", 0.02),
        Number("work over fracture energy", "energy balance", "work_ratio", "1", 3e-3),
    ],
    "linear_triangle": [
        Number("solutions at gamma = 1", "proof", "numbers[1]", "3", 0.0),
        Number("slip of A", "GetFEM", "solutions[1]['ut_A']", "-0.0397846", 2e-6),
        Number("normal force, A sticks", "GetFEM", "solutions[2]['sum_rn']", "1.3878265", 1e-7),
    ],
    "critical_friction": [
        Number("critical friction, n = 1", "closed form", "critical[0]", "closed_form", 1e-10),
        Number(
            "critical friction, n = 8", "independent numpy code", "critical[3]", "1.66953114", 1e-8
        ),
    ],
    "bouncing_bar": [
        Number("first impulse", "Doyen, Ern, Piperno", "impulses[0]", "800 / 3", 0.01),
        Number("second impulse", "Doyen, Ern, Piperno", "impulses[1]", "800 / 3", 0.01),
        Number("energy at the end", "conservation", "energies[-1]", "1", 0.01),
        Number("velocity of the second bar", "wave theory", "second_speed", "speed", 0.02),
        Number(
            "pressure between two bars", "wave theory", "contact_pressure", "exact_pressure", 0.02
        ),
    ],
    "own_law": [
        Number("distance of the shear from the ellipse", "the law", "worst", "0", 1e-8),
    ],
    "two_blocks": [
        Number(
            "normal force after the shear",
            "independent numpy code",
            "normal",
            "reference['normal']",
            1e-8,
        ),
        Number(
            "dissipation of the path",
            "independent numpy code",
            "dissipation",
            "reference['dissipation']",
            1e-8,
        ),
    ],
    "crack": [
        Number("error of the mean slip, extrapolated", "closed form", "extrapolated", "0", 0.02),
    ],
    "press_fit": [
        Number("pressure, MPa", "Lamé", "pressure", "lame_pressure", 0.01),
        Number("torque, N mm/mm", "closed form", "torque", "exact_torque", 0.01),
    ],
    "punch": [
        Number("order of the error of triangles", "theory", "orders[0]", "2", 0.25),
        Number("imbalance of the tool", "equilibrium", "imbalance", "0", 1e-8),
    ],
    "belt": [Number("T2/T1", "Euler, with the thickness", "ratios[-1]", "thick", 0.01)],
    "flattened_ring": [Number("whole over half ring", "symmetry", "ratio", "1", 0.01)],
    "hild_triangle": [
        Number("slip to the left", "closed form", "slips['-']", "closed_form['-']", 1e-10),
        Number("first fold", "closed form", "folds[0]", "friction / 4", 1e-10),
        Number("second fold", "closed form", "folds[1]", "kt / k / 4", 1e-10),
    ],
    "friction_parameter": [
        Number("solutions at strong friction", "enumeration", "len(solutions[-1])", "1", 0.0),
        Number("solutions in between", "enumeration", "len(solutions[1])", "3", 0.0),
    ],
    "chart": [
        Number("cusp, friction coefficient", "closed form", "cusps[0][0]", "2", 1e-10),
        Number("solutions above it", "Hild, Proposition 2", "numbers[3.0]", "3", 0.0),
    ],
    "proofs_3d": [
        Number("open regions of the proof", "certificate", "len(checked.open_regions)", "0", 0.0),
    ],
    "anisotropic": [
        Number(
            "further solutions on a finer mesh below the bound",
            "Ballard, Iurlano",
            "numbers[1.6][1] - numbers[1.6][0]",
            "0",
            0.0,
        ),
    ],
    "ciarlet_geymonat": [
        Number("branches", "GetFEM", "len(rows)", "6", 0.0),
        Number("asymmetry of mirror images, mm", "symmetry", "asymmetry", "0", 1e-9),
    ],
    "3d_branch": [
        Number("first contact", "rigid motion", "contact_at", "exact", 1e-8),
        Number("shear over normal force", "Coulomb", "F", "friction", 0.02),
    ],
    "followed_mesh": [
        Number("violation of the contact law", "the law", "max(violations)", "0", 1e-9),
    ],
    "regularised": [
        Number(
            "creep in a year, m",
            "closed form",
            "crept[-1]",
            "year * eps[-1] * np.arctanh(share)",
            1e-4,
        ),
    ],
    "bar": [
        Number("slip length", "closed form of a bar", "slip_length", "1", 0.05),
        Number(
            "dissipation of a cycle", "closed form of a bar", "dissipation", "closed_form", 0.01
        ),
    ],
    "adhesion": [
        Number("largest traction", "closed form", "traction.max()", "1", 1e-8),
        Number("work", "closed form", "work / fracture_energy", "71 / 72", 1e-8),
        Number("largest traction, viscous", "closed form", "viscous.max()", "1.107952", 0.02),
    ],
    "pull_out": [
        Number("pressure of the misfit", "Lamé", "pressure", "lame_pressure", 0.02),
        Number("force after the jump, N", "friction alone", "force[-1]", "plateau", 0.015),
    ],
    "own_interface": [
        Number("largest error of the force", "closed form", "worst", "0", 1e-3),
    ],
    "stick_slip": [
        Number("sliding distance", "point mass", "distance", "v0 * stop / 2", 0.01),
        Number("amplitude on the belt", "one mass", "amplitude", "belt_velocity / omega", 0.02),
    ],
    "thrown_body": [
        Number("balance of momentum", "contact forces", "momentum_error", "0", 1e-6),
        Number("balance of angular momentum", "contact forces", "moment_error", "0", 0.02),
    ],
    "squeal": [
        Number("growth", "independent numpy code", "modes.growth", "0.0980819683", 1e-8),
        Number("frequency", "independent numpy code", "modes.frequency", "2.9400657677", 1e-9),
        Number("onset of squeal", "independent numpy code", "onset.friction", "0.37678558", 1e-7),
    ],
    "shakedown": [
        Number(
            "cycles at rest below the bound",
            "Klarbring et al.",
            "endings['pair'][0] == ['rest']",
            "1",
            0.0,
        ),
    ],
    "wedging": [
        Number("wedging friction, n = 1", "closed form", "wedging[0]", "closed_form", 1e-8),
    ],
}


def run(name, folder, **parameters):
    """Run a demo in a folder and return its namespace.

    Args:
        name: name of the demo.
        folder: working directory, which is created.
        parameters: values for parameters at the top of the demo, by name.
    """
    file = ROOT / "demos" / f"demo_{name}.py"
    tree = ast.parse(file.read_text())
    left = dict(parameters)
    for node in tree.body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            several = isinstance(target, ast.Tuple)
            targets = target.elts if several else [target]
            for k, each in enumerate(targets):
                if isinstance(each, ast.Name) and each.id in left:
                    new = ast.parse(repr(left.pop(each.id)), mode="eval").body
                    if several:
                        value.elts[k] = new
                    else:
                        node.value = new
    assert not left, f"{name} has no parameters {', '.join(left)}"
    names = {"__name__": "__main__", "__file__": str(file)}
    Path(folder).mkdir(parents=True, exist_ok=True)
    with chdir(folder):
        exec(compile(ast.fix_missing_locations(tree), str(file), "exec"), names)
    MPI.COMM_WORLD.barrier()  # rank 0 writes the files
    return names


def rows_of(name, names):
    """Return the rows of a demo in the table."""
    rows = []
    for number in NUMBERS[name]:
        ours, exact, error = number.evaluated(names)
        values = (name, number.quantity, number.reference)
        rows.append((*values, f"{exact:.6g}", f"{ours:.6g}", f"{error:.1e}"))
    return rows


def main(chosen):
    """Run demos and replace their rows in the table."""
    for name in chosen or NUMBERS:
        with tempfile.TemporaryDirectory() as folder:
            new = rows_of(name, run(name, folder))
        rows = {}
        if TABLE.exists():
            with TABLE.open() as file:
                for row in csv.DictReader(file):
                    rows.setdefault(row["demo"], []).append([row[c] for c in COLUMNS])
        rows[name] = new
        with TABLE.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for each in NUMBERS:
                writer.writerows(rows.get(each, []))


if __name__ == "__main__":
    main(sys.argv[1:])
