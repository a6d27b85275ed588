# %% [markdown]
# A case in Python, cell by cell: run this file, or open it as a notebook.

# %%
import numpy as np

import hodo_cli as hodo

# %% [markdown]
# The keys of a case are those of a case file (docs/case-files.md). The result is an
# xarray.Dataset: the motion, its labels and crossings, and the measured error in `attrs`.

# %%
case = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 1000},
}
motion = hodo.run(case)
motion

# %%
print(f"crosses at {motion.crossing_time.item():.6f}, error {motion.attrs['error']:.0e}")

# %% [markdown]
# What follows from the angular velocity is a line of numpy away.

# %%
G = motion.omega.values * case["inertia"]
size = np.linalg.norm(G, axis=1)
print(f"|G| falls from {size[0]:.4f} to {size[-1]:.4f}")

# %%
hodograph = hodo.plot(motion, colour="axis")
hodograph

# %% [markdown]
# A sweep varies one key or several; its axes are dimensions of the dataset.

# %%
sweep = hodo.sweep({**case, "sweep": {"damping.2": {"linspace": [0.001, 0.009, 9]}}})
turned = sweep.crossing_time.where(sweep.crossings > 0)
print(f"{int((sweep.crossings > 0).sum())} of {sweep.crossings.size} members turn to x3")
print(f"the first of them at {float(turned.min()):.2f}")

# %% [markdown]
# Any sum of torques: a brake beside drag and a fluid. The stop is an event of the motion.

# %%
braked = hodo.run(
    {
        "model": "torques",
        "inertia": [2, 1.5, 1],
        "quadratic": 0.01,
        "kappa": 0.02,
        "brake": 0.004,
        "initial": {"p": 0.3, "q": 0.7, "r": -0.9},
        "time": {"end": 300},
    }
)
print(f"{braked.attrs['predictions']}; stops at {braked.event_time.item():.6f}")

# %% [markdown]
# Mistakes name the key.

# %%
try:
    hodo.run({**case, "damping": [0.005, 0.004]})
except hodo.HodoError as mistake:
    print(mistake)
