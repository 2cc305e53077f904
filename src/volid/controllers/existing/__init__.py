"""Compensations that exist already as files of a control: read, described, converted; what results on top of them refer to."""
