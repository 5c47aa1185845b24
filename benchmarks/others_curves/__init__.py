"""Curves drawn by formulas that share no code with the laws and effects that are looked for in them.

law.py        the contact: an integral equation solved by quadrature, and two laws of finite strain
protocol.py   the presses: rates, holds, repeats, waits, spacing, drawn widely
noise.py      what is read of them: stated or not, alike neighbours, heavy tails, heavy presses, steps
hidden.py     what may be wrong, of the catalogue and outside it
recording.py  the folder, written as text from the format alone
judge.py      what is said of it, and exact intervals of how often
"""
