"""Statuses: contact, friction and bonds, with one letter for each combination."""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact import ParametricContact
from dolfinx_contact.continuation import Piece
from dolfinx_contact.laws import BilinearCohesive, Tresca, status

BONDS = {0: "", status.DAMAGING: ", damaging", status.BROKEN: ", broken"}
FRICTION = {
    status.OPEN: "open",
    status.STICK: "stick",
    status.PLUS: "slip, $u_t > 0$",
    status.MINUS: "slip, $u_t < 0$",
    status.STICK + status.WHERE_OPEN: "open, held by friction",
    status.PLUS + status.WHERE_OPEN: "open, rubbing, $u_t > 0$",
    status.MINUS + status.WHERE_OPEN: "open, rubbing, $u_t < 0$",
}


@pytest.mark.parametrize("dim", [2, 3])
def test_every_status_has_a_letter_of_its_own(dim):
    letters = status.letters(dim)
    seen = set()
    for (contact, name), (bond, more) in itertools.product(FRICTION.items(), BONDS.items()):
        if dim == 3 and contact in (status.MINUS, status.MINUS + status.WHERE_OPEN):
            continue  # slips in space have no sense
        words = name.partition(", $")[0] if dim == 3 else name
        letter = str(letters[contact + bond])
        assert status.NAMES[letter] == words + more
        assert status.count(letter)[words.partition(",")[0]] == 1
        assert letter in status.COLOURS
        seen.add(letter)
    assert len(seen) == (21 if dim == 2 else 15)


def test_statuses_are_spelled_by_their_letters():
    closed = [status.OPEN, status.STICK, status.PLUS, status.MINUS]
    assert status.word(closed) == "ok+-"
    assert status.word([c + status.WHERE_OPEN for c in closed[1:]]) == "KPM"
    assert status.word(np.array(closed[:3], dtype=np.int8), dim=3) == "oks"
    assert status.word([]) == ""


@pytest.mark.each_value
@pytest.mark.parametrize("cell", ["quad", "hex"])
@pytest.mark.parametrize("law", [BilinearCohesive(2.0, 0.002, 0.01, 0.5), Tresca(1.0)])
def test_pieces_are_known_by_their_letters(cell, law):
    """Resumption uses the recorded letters of a branch for any law."""
    problem = block(n=2, cell=cell, law=law)
    system = ParametricContact(problem)
    codes = sorted(problem.surfaces[0].law_at_points.codes)
    for shift in range(len(codes)):
        mine = np.array(codes, dtype=np.int8)[(np.arange(len(system.clamped)) + shift) % len(codes)]
        letters = system.letters(Piece(mine))
        assert " " not in letters
        free = ~system.clamped
        again = system.piece_of(letters).codes
        np.testing.assert_array_equal(again[free], mine[free])
    assert MPI.COMM_WORLD.allreduce(int((~system.clamped).sum())) > 2


def test_statuses_of_friction_and_bond_are_independent():
    """Numbers of the three parts follow from the number of the combination."""
    for contact, bond in itertools.product(FRICTION, BONDS):
        code = np.array([contact + bond], dtype=np.int8)
        assert status.without_damage(code) == contact
        rubs = contact > status.WHERE_OPEN
        assert status.senses(code) == (contact - status.WHERE_OPEN if rubs else contact)
        assert status.closed(code) == (status.OPEN < contact <= status.WHERE_OPEN)
