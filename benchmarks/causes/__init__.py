"""Causes on fresh worlds: campaigns whose truth is drawn, the diagnosis of each, one judge, one table.

    python -m benchmarks.causes CAMPAIGN ... [--seed N] [--cases A:B] [--rows FILE] [--workers 2]

Campaigns (how many are drawn from a seed):

- none (60): nothing is wrong, four jumps in five of white noise; forces (180): one to four mechanisms;
- tails (60): noise of Student's t3 or with outliers of 8 to 60 sigma, one mechanism or none in turn;
- laboratories (120): a recording, a day, an order or an apparatus is wrong; both (24): that beside a force;
- scatter (60): a number that differs from jump to jump;
- laws (62): laws outside the list, on sand and hard ground, some that give energy, some of the camera;
- machines (56): studies of other people, `machines`.

The laboratory, or an integrator of their own (`tests/worlds`), makes the jumps; scipy those of the machines.
"""
