"""Pictures of gel drawn by a path tracer that others wrote (Mitsuba 3), with lamps that cast shadows.

Needs the extra `render`; nothing is imported of it before something is rendered.
"""
