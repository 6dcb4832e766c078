# SPDX-License-Identifier: GPL-3.0-or-later
"""Making a model from labelled takes: skeleton, body, marker layout."""
