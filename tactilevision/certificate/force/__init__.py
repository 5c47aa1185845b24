"""The force of a press: tare, phases, window, and the value at the contact event."""
