"""Mutation testing of the safety core: mutmut's mutations, run in forked processes.

mutmut makes the mutations. It would also run them, but through a trampoline around each function,
which leaves out whatever is decorated (properties, cached functions) and what stands outside of
functions (tables, defaults of dataclasses). Here a mutant is the changed source text itself, given
to the import system of a process that has not imported the package yet; so nothing is left out,
and the mutant is imported the way the original is.
"""
