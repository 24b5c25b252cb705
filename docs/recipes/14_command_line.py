# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I set solver options from the command line?
#
# Parse the arguments of a script with `parse_arguments`: argparse checks your own options, and
# words with one dash are passed to PETSc. Options of a contact problem have the prefix `contact_`
# and override `petsc_options`. The environment variable `PETSC_OPTIONS` has the same effect without
# parsing.

import argparse

from common import Block

from dolfinx_contact import parse_arguments

parser = argparse.ArgumentParser()
parser.add_argument("--n", type=int, default=4)
words = ["--n", "6", "-contact_snes_rtol", "1e-12"]  # as after the name of the script
args = parse_arguments(parser, words)  # without words: those of the command line
result = Block(args.n).problem().solve()
print(args.n, result.history[-1])
assert args.n == 6
assert result.kkt_violation < 1e-10
