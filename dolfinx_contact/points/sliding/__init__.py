# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large sliding between the faces of two bodies."""
