"""The regression digest: what the commands give, recorded once and compared after every change of the code.

Only the command line is used, and the files it writes: the digest outlives any renaming inside the packages.
"""
