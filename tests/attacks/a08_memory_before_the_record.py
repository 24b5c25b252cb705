"""A record begins with the second run of a history: its start has a memory of slip, which a script
that resumes does not have, since it makes the history anew and goes through no first run.

The answer is that of both runs, never killed.
"""

import contextlib

from recorded import Killed, Killer, compare, dragged, folder

from dolfinx_contact.records import EvolutionRecord

FIRST = (0.0, 1.0, 2.0)
SECOND = (2.0, 2.5, 3.0)


def attack(case):
    where = folder(case.comm)
    evolution = dragged(case.comm).evolution
    evolution.run(FIRST)
    with EvolutionRecord(where, evolution) as record, contextlib.suppress(Killed):
        evolution.run(SECOND, record=record, observer=Killer(1))
    with EvolutionRecord(where, dragged(case.comm).evolution, resume=True) as record:
        found = record.go_on()
    whole = dragged(case.comm).evolution
    whole.run(FIRST)
    compare(case, found, whole.run(SECOND))
