"""What an experimenter gets wrong: recordings of force and depth with faults that real rigs have.

design.py     the gel, the presses and the noise of a recording, drawn from its seed
faults.py     twenty kinds of fault, by formulas that share no code with the laws and effects looked for in them
recording.py  the folder that is written, how visible the fault is in it, and what it does to E
named.py      which answers name each kind rightly
judge.py      what `calibrate` and `diagnose` say of it, and how often they are right
"""
