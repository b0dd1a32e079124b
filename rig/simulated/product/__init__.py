"""The products that are simulated: what each can do, and one of them under its name in the system.

In: NI's data sheets and manuals, as tables.
Out: physical channels, terminals and coerced rates, with the driver's refusals.
"""
