"""What the papers say: the kinds of check, the verdicts, and that every claim gets the one
expected."""

import json
import math
import operator
import re
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from conftest import ROOT, call, schema
from test_case import fits
from test_case import rows_of as mistakes_of

import hodo_cli
from hodo_cli import HodoError
from hodo_cli.cases.config import load, parse

CHECK_KINDS = {
    keys["properties"]["kind"]["enum"][0]: keys["properties"]
    for keys in schema()["$defs"]["check"]["oneOf"]
}
"""The keys of each kind of check."""

LINEAR = "model: linear-diag, inertia: [1, 0.8, 0.6]"
MOVES, R1 = "initial: {p: 0.8, q: 0.5, r: 0.74}", "initial: {p: 0, q: 0, r: 1}"
TURN = f"{LINEAR}, {MOVES}, time: {{end: 100, samples: 101}}"
TURNING = f"{TURN}, damping: [0.05, 0.04, 0.03]"
SPUN = "model: cavity+constant, inertia: [8, 8, 4], cavity: {kappa: 0.1}, epsilon: 1"
FALLING = f"{SPUN}, torque: [0, 0, -0.1]"
ABOUT_X3 = "model: torques, inertia: [120, 100, 80], time: {end: 200, samples: 2}"
BRAKED = "model: torques, inertia: [120, 100, 80], brake: 0.05, initial: {p: 0.05, q: 0.3, r: 0.1}"
# Steps for two members take longer to compile than these do.
ROTOR = "model: torques, inertia: [3, 2, 1], damping: 0.1, rotor: [0, 0, 0.5], "
ROTOR += "initial: {p: 1, q: 0.6, r: 0.9}, method: collocation"
WAVE = f"model: torques, inertia: [2, 1.5, 1], {R1}"
SLOW_WAVE = 'expression: ["0", "0", "31.41592653589793*cos(62.83185307179586*t)"]'
TOP = "model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, mu: 0.5"
# The rotation about [0.2, -0.1, 0.3].
X, Y, Z = 0.2, -0.1, 0.3
ANGLE = math.hypot(X, Y, Z)
CROSS = np.array([[0, -Z, Y], [Z, 0, -X], [-Y, X, 0]]) / ANGLE
TILT = np.eye(3) + math.sin(ANGLE) * CROSS + (1 - math.cos(ANGLE)) * CROSS @ CROSS
TURNED = (TILT @ np.diag([1, 0.8, 0.6]) @ TILT.T).tolist()
START = dict(zip("pqr", (TILT @ [0.1, 0, 1]).tolist(), strict=True))
MOTIONS = f"""
title: t
defaults: {{time: {{end: 10, samples: 101}}}}
cases:
  # r is exp(-0.1 t), exp(-0.2 t), exp(-0.11 t), exp(-0.23 t) and exp(0.0005 t).
  slow: {{{LINEAR}, damping: 0.1, {R1}}}
  fast: {{{LINEAR}, damping: 0.2, {R1}}}
  slower: {{{LINEAR}, damping: 0.11, {R1}}}
  faster: {{{LINEAR}, damping: 0.23, {R1}}}
  fed: {{{LINEAR}, damping: -0.0005, {R1}}}
  rest: {{{LINEAR}, damping: 0.1, initial: {{p: 0, q: 0, r: 0}}}}
  # (G1, G2) librates about x3 at the rate r sqrt((A1 - A3)(A2 - A3)/(A1 A2)) = 0.316.
  free: {{{LINEAR}, initial: {{p: 0.1, q: 0, r: 1}}, time: {{end: 40}}}}
  faint: {{{LINEAR}, initial: {{p: 1.0e-4, q: 0, r: 1}}, time: {{end: 40}}}}
  # D = 2.4e-9 is the difference of terms near 0.1, of which their rounding is a part in 1e7.
  beside-separatrix: {{model: linear-diag, inertia: [1.2, 1, 0.3],
                       initial: {{p: 1.0e-4, q: 1, r: 0}}, time: {{end: 400, samples: 2001}}}}
  # The same in other axes.
  turned: {{model: torques, damping: 0, inertia: {TURNED}, initial: {START}, time: {{end: 40}}}}
  # Their G, which is constant, goes astray, within the stated errors.
  coarse: {{{TURN}, method: RK45, tol: 1.0e-3}}
  finer: {{{TURN}, method: RK45, tol: 1.0e-4}}
  turning: {{{TURNING}}}
  late: {{{TURNING.replace("end: 100, samples: 101", "values: [90, 100]")}}}
  # A brake stops it at 632.5, before its first sample.
  stopped: {{{BRAKED}, time: {{values: [700, 800]}}}}
  braked: {{{BRAKED}, time: {{end: 800, samples: 801}}}}
  staying: {{{TURN}, damping: [0.03, 0.04, 0.05]}}
  ball: {{{TURNING}, sweep: {{
          from: {{sphere: {{count: 40, seed: 1}}}}, damping.0: {{values: [0.05]}}}}}}
  by-0-and-2: {{{TURNING}, sweep: {{
                damping.0: {{values: [0.05, 0.01]}}, damping.2: {{values: [0.03, 0.01]}}}}}}
  by-2-and-0: {{{TURNING}, sweep: {{
                damping.2: {{values: [0.03, 0.01]}}, damping.0: {{values: [0.05, 0.01]}}}}}}
  given-up: {{{LINEAR}, {MOVES}, method: DOP853, max_steps: 3}}
  # r falls at the rate 0.1/4; the full form goes on, the averaged one has an event where r is 0.
  passing: {{{FALLING}, {R1}, time: {{end: 50}}}}
  stopping: {{{FALLING}, initial: {{x: 0, y: 1}}, form: averaged, time: {{end: 50}}}}
  # r = 1 - t/8, which a sample meets where it is 0.
  reversed: {{model: torques, inertia: [3, 2, 1], torque: [0, 0, -0.125], {R1},
              time: {{end: 16, samples: 17}}}}
  # r = exp(-0.1 t), of which doubles end near 7450.
  fading: {{{LINEAR}, damping: 0.1, {R1}, time: {{end: 20000, samples: 401}}}}
  # r = 1 + sin(20 pi t)/2, of which each sample meets the same phase; r = 1 + sin(4000 pi t)/2.
  swinging: {{{WAVE}, {SLOW_WAVE}}}
  rattling: {{{WAVE}, time: {{end: 0.5}},
              expression: ["0", "0", "6283.185307179586*cos(12566.370614359172*t)"]}}
  # A torque spins it up from 0.01 to 100, and it turns the faster.
  spun-up: {{model: torques, inertia: [3, 2.2, 1], torque: [0, 0, 1], time: {{end: 100}},
             initial: {{p: 0.001, q: 0.001, r: 0.01}}}}
  # What it stores is not the state.
  its-energy: {{{WAVE}, {SLOW_WAVE}, store: [T]}}
  # r = 0.01 t - 1, r = 1 + 0.01 t - 5e-5 t^2 and r = exp(-0.02 t + 1e-4 t^2): equal at both ends.
  turned-back: {{{ABOUT_X3}, torque: [0, 0, 0.8], initial: {{p: 0, q: 0, r: -1}}}}
  arching: {{{ABOUT_X3}, expression: [0, 0, 0.8 - 0.008*t], {R1}}}
  sagging: {{{ABOUT_X3}, expression: [0, 0, "-80*r*(0.02 - 0.0002*t)"], {R1}}}
  # r = 0.001 + 0.02 t - 1e-3 t^2 rises to t = 10.
  rising-first: {{{ABOUT_X3.replace("200", "60")}, expression: [0, 0, 1.6 - 0.16*t],
                  initial: {{p: 0, q: 0, r: 0.001}}}}
  # p = cos(14 deg - t/2), whose largest sample is cos(14 deg) = 0.970.
  humming: {{model: linear-diag, inertia: [2, 2, 1], time: {{end: 9.77384381116824, samples: 11}},
             initial: {{p: 0.970295726275996, q: 0.241921895599668, r: 1}}}}
  # DOP853 knows its crossing, at 28.000912709, to 1e-4.
  rough: {{model: cavity+constant, inertia: [1, 0.8, 0.6], kappa: 0.05, epsilon: 0.01,
           torque: [-1, 0.5, 0.7], initial: {{p: 0.5, q: 0.25, r: 1.4}},
           method: DOP853, tol: 1.0e-5, time: {{end: 40, samples: 401}}}}
  # It ends at its crossing, as near as a double can.
  near: {{{LINEAR}, {MOVES}, damping: [0.005, 0.004, 0.003],
          time: {{end: 305.358955166711, samples: 2001}}}}
  upright: {{{LINEAR}, initial: {{p: 0, q: 0, r: 2}}, attitude: yes}}
  # r falls to -0.075, so that y = r^2 comes back to 0.0056.
  returning: {{{FALLING}, {R1}, time: {{end: 43}}}}
  spinning: {{{SPUN}, torque: [0, 0, 0], initial: {{x: 0, y: 1}}, form: averaged}}
  rotor: {{{ROTOR}}}
  rotors: {{{ROTOR}, sweep: {{initial.q: {{values: [0.1, 0.6]}}}}}}
  # At rest G goes round nothing; the other member stays about x1.
  resting: {{model: torques, inertia: [3, 2, 1], damping: 0, method: collocation,
             initial: {{p: 1, q: 0, r: 0}}, sweep: {{initial.p: {{values: [0, 1]}}}}}}
  top: {{{TOP}, a: [0.125, 1], b: [0.1, 1], initial: {{theta: 5 deg, r: 1.7320508075688772}},
         time: {{end: 1, samples: 4001}}}}
  heavy: {{{TOP}, a: 0, b: 0, form: full, epsilon: 0.5, initial: {{theta: 60 deg, r: 1.7}},
           time: {{values: [0, 1, 2, 15, 20]}}}}
  fig4: {{{LINEAR}, {MOVES}, damping: [0.005, 0.004, 0.003], time: {{end: 1000, samples: 5}}}}
"""


def claims_block(*claims: str) -> str:
    lines = [f"  - {{id: c{i}, where: a, statement: b, {c}}}\n" for i, c in enumerate(claims)]
    return "claims:\n" + "".join(lines)


E1, E2, FED = math.exp(-1), math.exp(-2), -math.expm1(-0.005)
# The sample nearest to the end of spin has r = 0.00025.
RETURNED = (0.075**2 - 0.00025**2) / (1 - 0.00025**2)
AT_8 = "value, values: {end_of_spin: [8]}, within: 1.0e-9 -> reproduced 0"
CLOSE = "within: 1.0e-4 -> reproduced"
CHECKS = f"""
slow: monotone, of: [r, G, T, p], sense: falls -> reproduced 0
fed: monotone, of: [r], sense: falls -> contradicted 1
returning: monotone, of: [y], sense: falls -> plotting {RETURNED}
slow: value, values: {{r: [0.373]}}, within: 0.001 -> plotting {0.373 - E1}
# 1.1 % of the range of r, which begins at exp(-1).
slow: value, values: {{r: [0.375]}}, within: 0.001 -> contradicted {0.375 - E1}
slow: value, values: {{r: [1]}}, at: start, within: 0 -> reproduced 0
slow: bound, of: r, at: always, most: 0.5 -> contradicted 1
slow, fast: bound, of: r, most: 0.3 -> contradicted {E1}
# The bound that is nearest decides.
slow: bound, of: r, at: always, least: 0.3, most: 9 -> reproduced {E1}
staying: bound, of: first_crossing, least: 50 -> reproduced inf
staying: bound, of: first_crossing, most: 50 -> contradicted inf
# Its motion ends at 100.
staying: bound, of: first_crossing, least: 100.1 -> not tested
staying: value, values: {{first_crossing: [101]}}, within: 1 -> not tested
# A motion that no result stores does not end well.
{{case: turning, method: DOP853, max_steps: 3}}: crossings, least: 1 -> not tested
swinging: conserved, of: [r, T, G], within: 0.2 -> contradicted
swinging: formula, of: r, formula: 1 + sin(62.83185307179586*t)/2 -> reproduced 0
its-energy: conserved, of: [T], within: 0.2 -> contradicted
turned-back: conserved, of: [T, G], within: 1.0e-9 -> contradicted
arching: bound, of: r, at: always, most: 1.0001 -> contradicted 1.5
sagging: conserved, of: [r], within: 0.5 -> contradicted
rising-first: monotone, of: [r], sense: falls -> contradicted
{{case: slow, time: {{samples: 2}}}}: formula, of: r, formula: 1 - 0.06321*t, within: 1.0e-4
    -> contradicted
humming: bound, of: p, at: always, most: 0.971 -> contradicted 1
humming: bound, of: p, at: always, most: 1.000000000001 -> reproduced 1
humming: bound, of: x1_direction, at: always, least: 1.0e-6 -> plotting 0
rattling: conserved, of: [r] -> contradicted
rattling: bound, of: r, at: always, most: 1.2 -> contradicted
rattling: bound, of: r, at: always, most: 1.5 -> reproduced
spun-up: bound, of: p, at: always, most: 0.0001 -> contradicted
# More turns than 50,001 samples show.
{{case: spun-up, time: {{end: 500}}}}: monotone, of: [p], sense: falls -> not tested
slow, slow: order, of: r, sense: falls -> contradicted 0
slow, fast: order, of: r, sense: equal -> contradicted {1 - E1}
slow, fast, slow, fast: order, of: r, sense: falls, by: 2 -> reproduced {E1 - E2}
slow, fast, slow, fast: order, of: r, sense: falls -> contradicted {E1 - E2}
coarse, finer: order, of: G, sense: falls -> not tested
coarse, finer: order, of: G, sense: equal -> not tested
coarse, finer: order, of: r, at: start, sense: equal -> reproduced 0
coarse: conserved, of: [G] -> not tested
coarse: monotone, of: [G], sense: rises -> not tested
coarse: formula, of: G, formula: '1.02' -> not tested
coarse: bound, of: G, at: always, least: 1.01 -> not tested
# No error of theirs makes a doubt of so much.
coarse: conserved, of: [G], within: 0.999 -> reproduced
beside-separatrix: conserved, of: [D, T, G] -> reproduced
beside-separatrix: formula, of: D, formula: '2.4e-9' -> reproduced
beside-separatrix: monotone, of: [D], sense: falls -> not tested
{{case: slow, time: {{values: [1, 2]}}}}: formula, of: r, formula: exp(-t/10) -> reproduced 0
slow: formula, of: r, formula: 1 - t/100 -> contradicted {0.9 - E1}
slow: formula, of: r, formula: r/(t - t) -> contradicted
slow: formula, of: r, formula: sqrt(-t) -> not tested
fed: conserved, of: [G] -> plotting {FED}
turning: axis, start: x1, end: x3 -> reproduced 1
turning: axis, start: x3 -> contradicted 0
# Its samples begin behind the crossing.
late: axis, start: x1, end: x3 -> reproduced 1
late: axis, end: x3, turns: 0.1 -> reproduced 1
stopped: axis, start: x1 -> contradicted 0
stopped: axis, start: x3, end: x3 -> reproduced 1
braked: axis, end: x1 -> contradicted 0
{{case: braked, brake: 0.06}}: axis, end: x3 -> reproduced 1
{{case: braked, damping: [0.1, 0.2, 0.1]}}: axis, start: x3 -> reproduced 1
rest: axis, start: x3 -> not tested
late: value, values: {{turns: [0.6867]}}, within: 0.0001 -> reproduced
late: value, values: {{G: [0.9986]}}, at: start, within: 1.0e-4 -> reproduced
late: bound, of: G, at: always, most: 0.99 -> plotting
by-0-and-2, by-2-and-0: average, variable: crossing_time, at: [{{damping.0: 0}}], most: 0
    -> reproduced 0
# Free motion goes round x3 twice; here G is damped away in less than a turn.
free: axis, start: x3, end: x3, turns: 2 -> reproduced 1
free: axis, start: x3, turns: 2.1 -> contradicted 0
turning: axis, start: x1, end: x3, turns: 1 -> contradicted 0
turning: crossings, from: x3 -> contradicted 1
staying: crossings, from: x3 -> contradicted 0
staying: crossings, from: x3, most: 1 -> reproduced 0
turning: crossings, most: 0 -> contradicted 1
given-up: crossings, most: 0 -> not tested
ball: average, variable: start_axis.x1, at: [{{damping.0: 0}}], most: 1 -> reproduced
# Without a position or an axis it is one average over all members.
ball: average, variable: start_axis.x1, least: 1 -> contradicted
ball: average, variable: start_axis.x1, at: [{{}}, {{damping.0: 0}}], sense: equal, within: 1
    -> reproduced
ball: average, variable: start_axis.x1, at: [{{damping.0: 0}}], along: [damping.0], most: 1
    -> reproduced
passing, stopping: value, values: {{end_of_spin: [40, 40]}}, within: 1.0e-9 -> reproduced 0
reversed: {AT_8}
{{case: reversed, time: {{samples: 18}}}}: {AT_8}
{{case: reversed, time: {{end: 8, samples: 9}}}}: {AT_8}
{{case: reversed, initial: {{p: 0, q: 0, r: 1.0e-150}}, torque: [0, 0, -1.25e-151]}}: {AT_8}
{{case: reversed, torque: 0, brake: 0.125, time: {{samples: 18}}}}: {AT_8}
{{case: reversed, time: {{values: [0, 16]}}}}: bound, of: end_of_spin, most: 9 -> reproduced 8
fading: bound, of: end_of_spin, least: 9 -> reproduced inf
spinning: bound, of: end_of_spin, least: 60 -> not tested
# tests/data/crossings.csv
{{case: top, time: {{end: 4, samples: 5}}}}: value, values: {{rebound_u3: [0.40076030988]}},
    within: 1.0e-10 -> reproduced
# By scipy's DOP853 from the equations, with 2,000,001 samples for the turns and the area.
{{case: passing, cavity: {{kappa: 0.6048}}, epsilon: 0.1, initial: {{p: 1, q: 0, r: 1}}}}:
    value, values: {{end_of_spin: [40.00875091]}}, within: 1.0e-7 -> reproduced
{{case: fig4, time: {{samples: 501}}}}: value, values: {{turns: [6.55648]}}, {CLOSE}
{{case: fig4, time: {{samples: 401}}}}: value, values: {{visible_turns_x3: [1.53857]}}, {CLOSE}
fig4: value, values: {{visible_turns_x1: [6.55648]}}, {CLOSE}
{{case: fig4, time: {{samples: 401}}}}: value, values: {{area_smallest: [0.0637146]}}, {CLOSE}
{{case: fig4, time: {{samples: 11}}}}: value, values: {{area_largest: [1]}}, {CLOSE}
# Its w1^2 is largest between the first two samples, K w3^2 where it crosses.
{{case: fig4, initial: {{p: 0.8, q: 0.15, r: 0.74}}, time: {{end: 400, samples: 401}}}}:
    value, values: {{area_smallest: [0.01580515]}}, within: 1.0e-6 -> reproduced
# The second is the first, which crosses at 30 or so.
turning, {{case: turning, time: {{end: 10}}}}: order, of: first_crossing, sense: rises -> not tested
turning, staying: order, of: first_crossing, sense: rises -> reproduced
heavy: paper, name: period-as-printed -> contradicted
# Shorter than a period, and without two times in common: nothing to compare.
{{case: heavy, epsilon: 0.1, time: {{end: 0.01, samples: 9}}}}: paper, name: period -> not tested
{{case: passing, time: {{values: [1, 2]}}}}, {{case: stopping, time: {{values: [3, 4]}}}}:
    paper, name: averaging-is-exact -> not tested
free: paper, name: no-closed-form -> contradicted 0
turned: value, values: {{area_largest: [0], area_smallest: [1]}}, within: 0 -> reproduced 0
# The first factor raises the rate of decay by 0.1 and 0.12, the second by 0.01 and 0.03.
slow, fast, slower, faster: paper, name: diagonal-sets-decay -> reproduced 5.5
# At rest there is no ratio, and of what is not a number nothing is decided.
rest: monotone, of: [separatrix_distance], sense: falls -> not tested
rest: value, values: {{separatrix_distance: [1]}}, within: 0.9 -> not tested
rest, free: order, of: separatrix_distance, sense: equal -> not tested
rest, free: conserved, of: [separatrix_distance], within: 0.9 -> not tested
# G that falls by 0.7 % of itself, and by all of its range, and a component under two names.
{{case: slow, damping: 0.0007}}: bound, of: G, at: always, least: 0.6 -> contradicted
faint: conserved, of: [p] -> contradicted
faint: conserved, of: [omega.x1] -> contradicted
# A bound is missed by parts of the own range of a component, a law by those of its largest value.
faint: bound, of: p, at: always, least: -9.92e-5 -> plotting
faint: bound, of: omega.x1, at: always, least: -9.6e-5 -> contradicted
faint: formula, of: p, formula: p + 4.0e-7 -> plotting
faint: formula, of: omega.x1, formula: p + 2.0e-6 -> contradicted
faint: bound, of: x1_direction, at: always, least: 4.0e-7 -> plotting
faint: formula, of: T, formula: T + 0.0012 -> plotting
faint: formula, of: T, formula: T + 0.006 -> contradicted
staying: bound, of: growth_largest, least: 0 -> contradicted
# A case with other values is integrated for the statement alone.
{{case: slow, damping: 0.2}}: value, values: {{r: [{E2}]}}, within: 1.0e-9 -> reproduced
# Of `time` and `assumes` what is not changed stays.
{{case: slow, time: {{end: 5}}, assumes: {{a: b}}}}: value, values: {{r: [{math.exp(-0.5)}]}},
    within: 1.0e-9 -> reproduced
{{case: passing, form: averaged, initial: {{x: 0, y: 1}}}}: value, values: {{end_of_spin: [40]}},
    within: 1.0e-9 -> reproduced
{{case: given-up, method: auto}}: monotone, of: [r], sense: falls -> not tested
# What is not known well enough.
near: crossings, most: 0 -> not tested
near: axis, end: x1 -> not tested
near: axis, start: x1 -> reproduced
upright: bound, of: psi, least: 0 -> not tested
rough: value, values: {{first_crossing: [28.00079149]}}, within: 1.0e-6 -> not tested
rough: bound, of: first_crossing, most: 28.1 -> reproduced
# q is known to 1.1e-4, and its largest value is 1.330942.
rough: bound, of: q, at: always, most: 1.3309 -> reproduced
rough: bound, of: q, at: always, most: 1.32 -> plotting
"""
"""Cases, the check of them, the verdict and the number that decides, where it is known."""


def rows_of(text: str) -> list[list[str]]:
    """The rows of a table: what is claimed, the verdict, and what follows that."""
    lines = [line for line in re.sub(r"\n +", " ", text).splitlines() if line[:1] not in ("", "#")]
    return [re.split(rf" -> (?=(?:{'|'.join(WORDS)}))({'|'.join(WORDS)}) ?", x) for x in lines]


WORDS = (
    "plotting", "contradicted", "under-determined", "not tested", "holds by theorem",
    "reproduced as printed only", "reproduced once corrected", "reproduced", "by reading",
    "not confirmed", "confirmed",
)  # fmt: skip
"""The verdicts, that to plotting accuracy by its last words."""

TURNS = "check: {kind: crossings, least: 1}"
FALLS = "check: {kind: monotone, of: [r], sense: falls}"
Y_FALLS = "check: {kind: monotone, of: [y], sense: falls}"
OVER = "over: {damping.0: {values: ["
HALF_TURN = f"{OVER}0.05, 0.03]}}}}"
NO_D, NO_AXES = (f"not tested case {x}: with a rotor D says nothing" for x in ("rotor", "rotors"))
SPHERE = "over: {from: {sphere: {count: 40, seed: 1}}}"
MEMBERS = f"""
cases: turning, {TURNS}, {OVER}0.03, 0.02]}}}}
    -> contradicted holds on 0 of 2 members; largest violation at damping.0 = 0.03 (no crossing)
cases: turning, {TURNS}, {HALF_TURN}
    -> under-determined holds on 1 of 2 members, 0 to 1; largest violation at damping.0 = 0.03
    (no crossing)
cases: returning, {Y_FALLS}, over: {{torque.2: {{values: [-0.1, -0.09]}}}}
    -> plotting holds on 2 of 2 members, 0 to 0.00562; largest violation 0.562 % of the range at
    torque.2 = -0.1 (y goes back by 0.562 % of its range at 43)
# The members change a case with other values once more.
cases: {{case: slow, damping: 0.2}}, check: {{kind: bound, of: r, most: 0.13}},
    over: {{damping.2: {{values: [0.205, 0.25]}}}} -> reproduced
# The digits that decide, and nothing after them.
cases: [slow], check: {{kind: value, values: {{r: [0.367881]}}, within: 5.0e-7}}
    -> plotting r = 0.367879 (printed: 0.367881)$
cases: [slow], check: {{kind: bound, of: r, most: 0.36788}} -> reproduced r = 0.367879$
cases: [slow], check: {{kind: value, values: {{r: [0.37]}}, within: 0.005}}
    -> reproduced r = 0.3679 (printed: 0.37)$
cases: [slow, {{case: slow, damping: 0.1000001}}], check: {{kind: order, of: r, sense: falls}}
    -> reproduced r: 0.3678794, 0.3678791$
cases: [by-0-and-2], check: {{kind: average, variable: omega.x3, at: [{{}}], most: -0.06194}}
    -> reproduced omega.x3 = -0.061945$
# Errors that do not decide.
cases: [rough], check: {{kind: bound, of: first_crossing, most: 28.00085}}
    -> not tested first_crossing of case rough is known to 0.00012 only
cases: [near], check: {{kind: crossings, most: 0}}
    -> not tested case near: it is undecided whether the motion crosses the separatrix
# With a rotor D says nothing about axes, crossings and turns.
cases: rotor, check: {{kind: axis, start: x1}} -> {NO_D}
cases: rotor, check: {{kind: crossings, most: 0}} -> {NO_D}
cases: rotor, check: {{kind: bound, of: crossings, most: 0}} -> {NO_D}
cases: rotor, check: {{kind: bound, of: turns, least: 1}} -> {NO_D}
cases: rotor, check: {{kind: bound, of: visible_turns_x3, most: 1}} -> {NO_D}
cases: rotors, check: {{kind: average, variable: end_axis.x1, most: 0.1}} -> {NO_AXES}
cases: rotors, check: {{kind: average, variable: start_axis.x3, least: 0.9}} -> {NO_AXES}
cases: rotors, check: {{kind: average, variable: crossings, most: 0}} -> {NO_AXES}
# A share of an axis leaves out members without one.
cases: resting, check: {{kind: average, variable: end_axis.x1, least: 1}}
    -> reproduced end_axis.x1 = 1, 1 of 2 members have none
cases: braked, check: {{kind: axis, end: x3}}, over: {{brake: {{values: [0.05, 0.1]}}}}
    -> reproduced holds on 2 of 2 members
cases: braked, check: {{kind: axis, start: x3, turns: 0.01}}, over: {{brake: {{values: [0.05]}}}}
    -> reproduced holds on 1 of 1 members
# The members are those of a sweep.
cases: turning, check: {{kind: axis, start: x1}}, {SPHERE} -> under-determined holds on 17 of 40
cases: turning, check: {{kind: axis, start: x1}}, {SPHERE}, start: x1
    -> reproduced holds on 17 of 17
cases: ball, check: {{kind: average, variable: start_axis.x1, at: [{{damping.0: 0}}], least: 0}}
    -> reproduced start_axis.x1 = 0.425
# The members change every case alike.
cases: [slow, fast], check: {{kind: order, of: r, sense: equal}},
    over: {{damping.2: {{values: [0.1, 0.3]}}}} -> reproduced holds on 2 of 2 members
cases: turning, check: {{kind: value, values: {{G: [{math.hypot(0.8, 0.4, 0.444)}]}},
    at: start, within: 1.0e-14}}, {SPHERE} -> reproduced holds on 40 of 40 members,
# Of several cases the one that decides is named.
cases: [slow, fast], check: {{kind: monotone, of: [r], sense: rises}}
    -> contradicted r goes back by 100 % of its range at 10, case slow
cases: [fast, slow], check: {{kind: conserved, of: [r]}}
    -> contradicted r: relative change at most 0.86, case fast
cases: [slow, fast], check: {{kind: bound, of: r, least: 0.2, at: always}}
    -> contradicted r from 0.1353 to 1, case fast
# What is open about one case does not help where another contradicts.
cases: [coarse, slow], check: {{kind: conserved, of: [G]}}
    -> contradicted G: relative change at most 0.63, case slow
# A member of a sample contradicts a statement about all.
cases: turning, {TURNS}, {HALF_TURN}, share: 0.5
    -> reproduced holds for 1 of 2 members of a sample (50 %), 0 to 1
cases: turning, {TURNS}, {HALF_TURN}, share: 0.6
    -> contradicted holds for 1 of 2 members of a sample (50 %), 0 to 1
# A theorem is tried on the members, and one of them refutes it.
cases: turning, {TURNS}, {OVER}0.05, 0.045]}}}}, theorem: D = 0
    -> holds by theorem holds on 2 of 2 members
cases: turning, {TURNS}, {HALF_TURN}, theorem: D = 0
    -> contradicted holds on 1 of 2 members, 0 to 1
# Members that do not cross have no time of it.
cases: by-0-and-2, check: {{kind: average, variable: crossing_time, most: 100}}
    -> reproduced crossing_time = 21.4, 2 of 4 members have none
readings: {{a: {{cases: slow}}, b: {{cases: returning, {Y_FALLS}}}}}, {FALLS} -> plotting
readings: {{a: {{cases: slow, theorem: x}}, b: {{cases: fast}}}}, {FALLS} -> reproduced
readings: {{a: {{cases: slow}}, b: {{cases: fast}}}}, {FALLS}, theorem: x -> holds by theorem
readings: {{a: {{cases: turning}}, b: {{cases: staying}}}}, {TURNS} -> under-determined
readings: {{a: {{cases: staying}}, b: {{cases: free}}}}, {TURNS} -> contradicted
readings: {{a: {{cases: slow}}, b: {{cases: given-up}}}}, {FALLS} -> not tested
# The members and the check of one reading only.
readings: {{a: {{cases: turning, {HALF_TURN}}}, b: {{cases: staying}}}}, {TURNS} -> under-determined
# A statement that inherits an erratum holds of the printed form alone.
erratum: sign, readings: {{as printed: {{cases: slow}}, corrected: {{cases: staying, {TURNS}}}}},
    {FALLS} -> reproduced as printed only
erratum: sign, readings: {{corrected: {{cases: slow}}, as printed: {{cases: staying, {TURNS}}}}},
    {FALLS} -> reproduced once corrected
erratum: sign, readings: {{as printed: {{cases: slow}}, corrected: {{cases: fast}}}}, {FALLS}
    -> reproduced
"""
"""Claims over members and with readings, their verdicts, and how the evidence begins."""

MISPRINTS = f"""
note: a -> by reading
cases: slow, check: {{kind: bound, of: r, most: 0.5}} -> confirmed
cases: slow, check: {{kind: bound, of: r, most: 0.3}} -> not confirmed
cases: given-up, check: {{kind: bound, of: r, most: 0.3}} -> not tested
readings: {{as printed: {{cases: staying}}, corrected: {{cases: turning}}}}, {TURNS} -> confirmed
readings: {{corrected: {{cases: staying}}, as printed: {{cases: turning}}}}, {TURNS}
    -> not confirmed
readings: {{as printed: {{cases: turning}}, corrected: {{cases: turning}}}}, {TURNS}
    -> not confirmed
"""
"""The checks of errata, and the verdicts."""


def verdict(words: str) -> str:
    return "reproduced to plotting accuracy" if words == "plotting" else words


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the case file, the result and the labels of all motions."""
    folder = tmp_path_factory.mktemp("motions")
    (folder / "c.yaml").write_text(MOTIONS, encoding="utf-8")
    assert call(folder, "run", "c.yaml").returncode == 1  # given-up
    assert call(folder, "classify", "c.yaml").returncode == 0
    return folder


def judged_by(stored: Path, block: str) -> dict[str, list[dict[str, Any]]]:
    """The tables of `hodo claims --json` for other claims on the stored motions."""
    (stored / "c.yaml").write_text(MOTIONS + block, encoding="utf-8")
    done = call(stored, "claims", "c.yaml", "--json")
    assert done.returncode in (0, 3), done.stderr
    return dict(json.loads(done.stdout))


def test_a_check_gives_its_verdict_and_the_number_that_decides(stored: Path) -> None:
    kind = rf": (?=(?:{'|'.join(CHECK_KINDS)}),)"
    rows = [(*re.split(kind, claim, maxsplit=1), *more) for claim, *more in rows_of(CHECKS)]
    tried = {check.partition(",")[0] for _, check, *_ in rows}
    assert tried == CHECK_KINDS.keys()
    claims = (f"cases: [{cases}], check: {{kind: {check}}}" for cases, check, *_ in rows)
    found = judged_by(stored, claims_block(*(f"{x}, expect: reproduced" for x in claims)))
    for row, (cases, check, words, number) in zip(found["statements"], rows, strict=True):
        assert row["verdict"] == verdict(words), (cases, check, row["evidence"])
        if number:
            value = math.inf if row["number"] is None else row["number"]
            assert value == pytest.approx(float(number), rel=1e-9, abs=1e-9), (cases, check)
    assert [*hodo_cli.open(stored / "runs" / "c.h5")] == [*parse(MOTIONS, "c.yaml").cases]


def test_members_and_readings_give_one_verdict_whose_evidence_names_the_worst(stored: Path) -> None:
    rows, misprints = rows_of(MEMBERS), rows_of(MISPRINTS)
    block = claims_block(*(f"{claim}, expect: reproduced" for claim, *_ in rows))
    block += "errata:\n  - {id: sign, where: a, printed: x, should_be: y}\n"
    for i, (check, *_) in enumerate(misprints):
        block += f"  - {{id: e{i}, where: a, printed: x, should_be: y, {check}}}\n"
    found = judged_by(stored, block)
    for row, (claim, words, evidence) in zip(found["statements"], rows, strict=True):
        assert row["verdict"] == verdict(words), (claim, row["evidence"])
        assert f"{row['evidence']}$".startswith(evidence), (claim, row["evidence"])
    given = r"a: reproduced \(.* \(x1 to x3\)\); b: contradicted \(no crossing\)"
    assert any(re.fullmatch(given, row["evidence"]) for row in found["statements"])
    words = [row["verdict"] for row in found["errata"]]
    assert words == ["by reading", *(words for _, words, _ in misprints)]


def test_the_page_drops_no_verdict(stored: Path) -> None:
    expected = [*["contradicted"] * 4, "reproduced"]
    claims = (f"cases: fast, check: {{kind: conserved, of: [T]}}, expect: {x}" for x in expected)
    (stored / "c.yaml").write_text(MOTIONS + claims_block(*claims), encoding="utf-8")
    page = call(stored, "claims", "c.yaml", "--markdown").stdout
    assert page.startswith("5 statements: 5 contradicted.\n")
    told = page.partition("<details>")[0]
    assert told.count("b **Contradicted**") == 4
    assert told.count("b **Contradicted (expected: reproduced)**") == 1


# Mistakes, each in one line.

NOT_JUDGED = f"""
cases: passing, check: {{kind: monotone, of: [H], sense: falls}} -> ... no gamma, which H needs
cases: slow, check: {{kind: bound, of: u1, most: 1}} -> case slow has no gamma, which u1 needs
cases: slow, check: {{kind: value, values: {{rebound_u3: [1]}}, within: 0.1}} -> ... which Gz needs
cases: [slow, free], check: {{kind: paper, name: equations-6-meet-the-start}} -> ... number of ...
cases: top, check: {{kind: bound, of: growth_largest, least: 0}} -> case top has no medium, ...
cases: slow, {FALLS}, {OVER}0.1]}}}}, start: x1 -> no member starts about x1
cases: turning, {TURNS}, over: {{inertia.0: {{values: [2.0]}}}} -> ...inertia...
cases: stopping, check: {{kind: bound, of: area_largest, least: 1}} -> case stopping has no labels \
of the enclosed axis: averaged over the hodograph's turns: it circles x3, and crosses nothing
"""
"""What is claimed, and why it cannot be judged."""


def test_a_claim_that_cannot_be_judged_is_refused(stored: Path) -> None:
    for claim, words in mistakes_of(NOT_JUDGED):
        text = MOTIONS + claims_block(f"{claim}, expect: reproduced")
        (stored / "c.yaml").write_text(text, encoding="utf-8")
        done = call(stored, "claims", "c.yaml")
        assert (done.returncode, done.stdout) == (2, "")
        place, _, said = done.stderr.splitlines()[-1].partition(": claims.0.check: ")
        # The place of the check, in the last line of the file.
        assert re.match(rf"c\.yaml:{len(text.splitlines())}:\d+", place)
        assert fits(said, words), said


MISTAKEN = f"""
cases: slow, check: {{kind: formula, of: r, formula: exp(-tau)}} -> check.formula: column 6 of ...
cases: slow, check: {{kind: formula, of: r}} -> check: missing 'formula'
cases: slow, check: {{kind: bound, of: G}} -> check: needs least or most: without, every motion...
cases: slow, check: {{kind: axis}} -> check: needs start or end: without, every motion...
cases: slow, check: {{kind: order, of: G, sense: falls}} -> check: ... groups of two ...
cases: free, check: {{kind: average, variable: error, most: 1}} -> cases.0: case free is no sweep...
cases: turnin, {TURNS} -> cases.0: unknown case 'turnin'; did you mean 'turning'?...
cases: {{case: slow, assumes: {{r0: ''}}}}, {FALLS} -> cases.0.assumes.r0: expected text, got ''
cases: slow, {FALLS}, {OVER}-.inf]}}}} -> over.damping.0.values.0: expected a finite ...
cases: slow, {FALLS}, {OVER}]}}}} -> over.damping.0.values: ... one or more: number, got a list of 0
cases: slow, {FALLS}, over: {{damping: [1, 2]}} -> over.damping...
cases: slow, {FALLS}, over: {{}} -> over: expected a mapping of keys (damping.2) to ...
cases: slow, {FALLS}, over: {{damping.0: {{linspace: [0, 1, 2e5]}}}} -> over: more than 100,000 ...
cases: slow, {FALLS}, {HALF_TURN}, start: x4 -> start: expected x1, x2 or x3, got 'x4'
cases: slow, {FALLS}, {HALF_TURN}, share: 1.5 -> share: expected a positive number <= 1, got 1.5
cases: slow, {FALLS}, seed: 3 -> seed: unknown key (valid: id, where, original, ...
cases: slow, {FALLS}, theorem: [a] -> theorem: expected text, got a list of 1
cases: slow, {FALLS}, theorm: a -> theorm: unknown key; did you mean 'theorem'?...
cases: slow, {FALLS}, erratum: sign -> readings: expected two readings...
readings: {{a: {{cases: slow, shar: 1}}}}, {FALLS} -> readings.a.shar: unknown key...
readings: {{a: {{cases: slow}}, b: {{cases: slow}}}}, {FALLS}, erratum: sign \
-> readings: expected two readings, 'as printed' and 'corrected'
"""
"""Claims as a case file may not give them, and why."""


@pytest.mark.parametrize(("claim", "words"), mistakes_of(MISTAKEN))
def test_a_wrong_claim_is_named_with_its_place(claim: str, words: str) -> None:
    case = f"&a {{{LINEAR}, initial: {{p: 0, q: 0, r: 1}}, time: {{end: 1}}}}"
    errata = "errata: [{id: sign, where: a, printed: x, should_be: y}]\n"
    block = claims_block(f"{claim}, expect: reproduced")
    with pytest.raises(HodoError) as raised:
        parse(f"cases: {{slow: {case}, free: *a, turning: *a}}\n{errata}{block}", "c.yaml")
    place, _, message = str(raised.value).partition(": claims.0.")
    assert re.fullmatch(r"c\.yaml:4:\d+", place)
    assert fits(message, words), message


# What the command stores, shows and wants.

TWO = f"""
cases:
  turning: {{{TURNING}}}
  given-up: {{{TURN}, method: DOP853, max_steps: 3}}
claims:
  - {{id: turns, where: Fig 1, statement: It turns., cases: turning, {TURNS}, expect: EXPECT}}
  - {{id: lost, where: Fig 2, statement: It turns., cases: given-up, {TURNS}, expect: not tested}}
"""


def write_case_file(folder: Path, expect: str = "reproduced", more: str = "") -> None:
    (folder / "c.yaml").write_text(TWO.replace("EXPECT", expect) + more, encoding="utf-8")


def test_a_verdict_that_is_not_the_expected_one_is_exit_status_3(tmp_path: Path) -> None:
    write_case_file(tmp_path, "contradicted")
    assert call(tmp_path, "run", "c.yaml").returncode == 1  # given-up
    assert call(tmp_path, "classify", "runs/c.h5").returncode == 0
    done = call(tmp_path, "claims", "runs/c.h5")
    assert done.returncode == 3, done.stderr
    assert "reproduced (EXPECTED: contradicted)" in done.stdout
    write_case_file(tmp_path)
    done = call(tmp_path, "claims", "c.yaml", "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["statements"]
    assert [[row[key] for key in ("id", "verdict", "number")] for row in rows] == [
        ["turns", "reproduced", 1],
        ["lost", "not tested", None],
    ]
    with h5py.File(tmp_path / "runs" / "c.h5") as file:
        stored = {name: column[:].astype("U").tolist() for name, column in file["_claims"].items()}
    assert stored["claim"] == ["turns", "lost"]
    assert stored["verdict"] == stored["expect"] == ["reproduced", "not tested"]
    assert "(x1 to x3)" in stored["evidence"][0]


def test_verdicts_are_given_once_until_what_they_rest_on_changes(tmp_path: Path) -> None:
    write_case_file(tmp_path)
    path = tmp_path / "runs" / "c.h5"
    call(tmp_path, "run", "c.yaml")
    call(tmp_path, "classify", "c.yaml")
    first, judged = call(tmp_path, "claims", path).stdout, path.read_bytes()
    # What was judged again would have another line of history.
    assert call(tmp_path, "claims", path).stdout == first
    assert path.read_bytes() == judged
    call(tmp_path, "run", "c.yaml", "--set", "turning.time.end=90", "--out", "other")
    (other,) = (tmp_path / "other").glob("*.h5")
    call(tmp_path, "classify", other)
    path.write_bytes(other.read_bytes())
    assert call(tmp_path, "claims", path).stdout == first
    assert path.read_bytes() != other.read_bytes()


def test_verdicts_go_with_the_statements_that_a_file_no_longer_makes(tmp_path: Path) -> None:
    errata = "errata: [{id: misprint, where: (1), printed: x, should_be: y}]\n"
    figures = "figures: {a: {kind: hodograph, cases: turning}}\n"
    write_case_file(tmp_path, more=figures + errata)
    path, page = tmp_path / "runs" / "c.h5", tmp_path / "runs" / "figures" / "index.html"

    def shown() -> list[bool]:
        call(tmp_path, "plot", "c.yaml")
        text = page.read_text(encoding="utf-8")
        return ["It turns." in text, "misprint" in text]

    for command in ("run", "classify", "claims"):
        call(tmp_path, command, "c.yaml")
    assert shown() == [True, True]
    cases = TWO.partition("claims:")[0]
    (tmp_path / "c.yaml").write_text(cases + figures + errata, encoding="utf-8")
    table, judged = call(tmp_path, "claims", "c.yaml").stdout, path.read_bytes()
    assert table.startswith("erratum ")
    assert call(tmp_path, "claims", "c.yaml").stdout == table
    assert path.read_bytes() == judged
    assert shown() == [False, True]
    (tmp_path / "c.yaml").write_text(cases + figures, encoding="utf-8")
    assert "has no claims: or errata:" in call(tmp_path, "claims", "c.yaml").stderr
    assert shown() == [False, False]


@pytest.fixture(scope="module", params=("paper1", "paper2", "paper3"))
def paper(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def config(paper: str) -> Any:
    return load(ROOT / "configs" / f"{paper}.yaml")


@pytest.fixture(scope="module")
def results(paper: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the results and the labels of a paper."""
    folder = tmp_path_factory.mktemp(paper)
    shutil.copytree(ROOT / "configs", folder / "configs")
    call(folder, "run", f"configs/{paper}.yaml", "--quiet")
    call(folder, "classify", f"runs/{paper}.h5")
    return folder


@pytest.fixture(scope="module")
def judged(results: Path, paper: str) -> Any:
    """The verdicts on the statements and on the misprints of a paper."""
    return json.loads(call(results, "claims", f"configs/{paper}.yaml", "--json").stdout)


def test_every_check_of_a_paper_is_used() -> None:
    """Case files know the checks by a list beside their modules, which they do not load."""
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "configs").glob("*.yaml")]
    used = {name for text in texts for name in re.findall(r"kind: paper, name: ([\w-]+)", text)}
    listed = yaml.safe_load((ROOT / "hodo_cli" / "papers" / "checks.yaml").read_text("utf-8"))
    kinds = [of.get(kind, ()) for of in listed.values() for kind in ("checks", "trends")]
    assert used == {name for names in kinds for name in names}


@pytest.mark.heyoka
def test_the_results_are_those_of_the_reference(results: Path, paper: str) -> None:
    """All variables of all cases; times to their stated errors."""
    reference = ROOT / "runs" / "reference" / f"{paper}.h5"
    done = call(results, "compare", f"runs/{paper}.h5", reference, "--rtol", "1e-11")
    assert done.returncode == 0, done.stdout


@pytest.mark.heyoka
def test_every_claim_of_the_papers_has_the_verdict_expected(judged: Any, config: Any) -> None:
    rows, errata = judged["statements"], judged["errata"]
    assert [row["id"] for row in rows] == [claim["id"] for claim in config.claims]
    assert not {row["id"] for row in rows if row["verdict"] != row["expect"]}
    assert not {row["id"] for row in rows if not row["contradicted_by"]}
    assert {row["id"]: row["verdict"] for row in errata} == {
        erratum["id"]: "confirmed" if erratum["cases"] or erratum["readings"] else "by reading"
        for erratum in config.errata
    }


NUMBERS: list[tuple[str, str, list[float | None], float]] = [
    ("paper1", "curve-3", [0.0535 / 1.0777**2], 5e-5),
    ("paper1", "fig10-area", [0.064], 5e-4),
    ("paper1", "fig16-area", [None, 0.074], 5e-4),
    ("paper1", "fig18-area", [None, 0.169], 5e-4),
    # With |G| > 0.1, by DOP853 at 1e-11; the turns below with 400,001 samples each.
    ("paper1", "fig16-turns", [0, 1.57], 0.005),
    ("paper1", "fig18-turns", [None, 1.528, 3.08], 0.005),
    ("paper1", "fig14-character", [0, 0, 0, 0], 0),
    ("paper1", "x3-growth", [0.0058333333, 0.0027083333], 3e-10),
    # Two standard deviations of 129 starts.
    ("paper1", "x1-stays", [1, 0.47], 0.09),
    ("paper1", "unit-of-angular-velocity", [0.524, None], 0.0005),
    ("paper1", "unit-of-angular-velocity", [None, 0.0022], 0.00005),
    # q1(0) is -0.774 where q0 is 0.
    ("paper1", "phase-in-equations-6", [0.774], 0.0005),
    # b^2 |omega|/nu with b^7 = 525 P0/(8 pi) and |omega| = sqrt(2).
    ("paper2", "small-Reynolds-number",
     [(525 * 0.48 / (8 * math.pi)) ** (2 / 7) * math.sqrt(2) / 1000], 1e-15),
    # To tau = 4, when Gz of case 3 still goes back.
    ("paper3", "case3-Gz", [0.00088], 1.8e-5),
    ("paper3", "error-of-order-epsilon", [1], 0.01),
]  # fmt: skip
"""Numbers that decide, of a statement or of all its readings, found by other means."""

EVIDENCE = [
    ("paper1", "fig4-separatrix", ["305.4 (x1 to x3)"]),
    # Over lambda1 and lambda2, which are not printed.
    ("paper1", "fig11-area", ["21 of 42 members, 0 to 0.477;"]),
    # The other two do not cross before tau = 1000.
    *(("paper1", name, ["40 of 40 pairs in this order", "41 of 42 pairs in this order"])
      for name in ("figs-10-11-order", "larger-difference-sooner")),
    ("paper1", "size-changes-spacing",
     ["turns: 14.19, 7.093, 3.577, 1.847; 4.995, 2.517, 1.259, 0.6627",
      "turns: 13.99, 6.778, 3.06, 1.695; 4.886, 2.742, 0.913, 0.7337"]),
    ("paper1", "larger-difference-trend", ["11.5 % of 494 pairs reversed"]),
    ("paper1", "fig12-turns", ["x3 to x1 (7.09, 4.73 turns)", "", "x3 to x1 (6.78, 0.329 turns)"]),
    ("paper2", "limits", ["x = 0.767, 0.7922, 0.503, 0.6007 (printed",
                          "x = 1.237, 1.216, 1.538, 1.456 (printed"]),
    ("paper2", "M1-M2-vanish", ["x off by 0.799, 0.568, 0.363, 0.228, 0.135"]),
    ("paper2", "slow-variables", ["0.0576, 0.0195 (p by 2)"]),
    ("paper3", "signs-change", ["at 0.4008, 1.757, 4.197"]),
    ("paper3", "case1-u3-quickly", ["holds on 49 of 49 members", "holds on 18 of 49 members"]),
]  # fmt: skip


@pytest.mark.heyoka
def test_the_numbers_that_decide_are_those_found_by_other_means(judged: Any, paper: str) -> None:
    rows = {row["id"]: row for row in (*judged["statements"], *judged["errata"])}

    def found(name: str, key: str, many: int) -> list[Any]:
        row = rows[name]
        return [each[key] for each in ([row] if many == 1 else row["readings"].values())]

    for name, numbers, within in (row for of, *row in NUMBERS if of == paper):
        pairs = zip(found(name, "number", len(numbers)), numbers, strict=True)
        wrong = [x for x, right in pairs if right is not None and abs(x - right) > within]
        assert not wrong, name
    for name, words in (row for of, *row in EVIDENCE if of == paper):
        said = found(name, "evidence", len(words))
        assert all(map(operator.contains, said, words)), (name, said)


def factorial(diagonal: float, off_diagonal: float, end: float) -> str:
    """Fig 16 with another tensor of resistance and another end."""
    tensor = f"resistance: {{diagonal: {diagonal}, off_diagonal: {off_diagonal}}}"
    return f"{{case: fig16, time: {{end: {end}}}, {tensor}}}"


# The two factors in the wrong order.
EXCHANGED = {
    end: ", ".join(
        factorial(diagonal, off, end) for diagonal in (0.001, 0.003) for off in (0.001, 0.003)
    )
    for end in (1000, 3000)
}

REFUTING = {
    "paper1": [("free-rotation", "fig4"), ("free-rotation-from-q0", "fig4"),
        ("equal-damping", "fig4"), ("turning-axis", "fig4"), ("turns-about-x1-only", "fig7"),
        ("turns-about-x3-only", "fig6"), ("criterion-predicts", "fig8"),
        ("equations-6-as-printed", "fig3-2"), ("equations-6-meet-the-start", "fig3-2"),
        ("diagonal-sets-decay", EXCHANGED[1000]), ("off-diagonal-sets-area", EXCHANGED[3000])],
    "paper2": [("averaging-is-exact", "{case: fig1, form: full}, fig2")],
    "paper3": [("u3-quickly", "case3, case2, case1"),
        ("u3-quickly-for-good", "case1, case2, case3"), ("H-quickly", "case3, case2, case1"),
        ("equation-1-3", "case1-full"),
        ("averaged-alike", "{case: case1, form: averaged-u}, case2"), ("signs-change", "case3"),
        ("period-as-printed", "{case: case2-full, a: [0], b: [0]}"),
        ("period", "{case: case2-full}"), ("smoothing", "case1-constant, case1")],
}  # fmt: skip
"""Checks of the papers, and motions of theirs that contradict what is checked."""


@pytest.mark.heyoka
def test_a_check_of_a_paper_fails_for_motions_that_do_otherwise(results: Path, paper: str) -> None:
    source = results / "configs" / f"{paper}.yaml"
    claims = [
        f"cases: [{cases}], check: {{kind: paper, name: {name}}}, expect: contradicted"
        for name, cases in REFUTING[paper]
    ]
    cases_and_figures = source.read_text(encoding="utf-8").partition("claims:")[0]
    source.write_text(cases_and_figures + claims_block(*claims), encoding="utf-8")
    done = call(results, "claims", f"configs/{paper}.yaml", "--json")
    rows = json.loads(done.stdout)["statements"]
    assert not [
        refuting
        for refuting, row in zip(REFUTING[paper], rows, strict=True)
        if row["verdict"] != "contradicted"
    ]


def test_the_page_of_a_paper_has_every_statement_and_misprint(paper: str, config: Any) -> None:
    """What `make docs` prints of the verdicts is that of the case files as they are now."""
    source = (ROOT / "docs" / f"{paper}.md").read_text(encoding="utf-8").replace("\\", "")
    rows = [[claim["where"], claim["statement"], claim["expect"]] for claim in config.claims]
    rows += [[each["where"], each["printed"], each["should_be"]] for each in config.errata]
    begins = [" | ".join(" ".join(cell.split()) for cell in row) for row in rows]
    missing = [begin for begin in begins if f"\n| {begin} | " not in source]
    assert not missing, "run `make docs`"


PAGE = f"""\
title: a page
cases:
  turning: {{{TURN}, assumes: {{horizon: "tau = 100"}}}}
claims:
  - {{id: right, where: Fig 1, statement: It turns | round x_1., cases: [turning],
     original: "", expect: reproduced, check: {{kind: axis, start: x1, end: x1}}}}
  - {{id: wrong, where: Fig 2, statement: It turns round x3., cases: [turning], note: not *so*,
     original: вокруг, expect: contradicted, check: {{kind: axis, start: x3, end: x3}}}}
errata: [{{id: sign, where: eq. 1, printed: +, should_be: -}}]
"""


def test_a_page_has_the_gravest_in_full_and_everything_in_tables(tmp_path: Path) -> None:
    (tmp_path / "page.yaml").write_text(PAGE, encoding="utf-8")
    for command in ("run", "classify"):
        assert call(tmp_path, command, "page.yaml").returncode == 0
    done = call(tmp_path, "claims", "page.yaml", "--markdown")
    assert (done.returncode, done.stderr) == (0, "")
    full, *tables = done.stdout.split("\n\n<details><summary>")
    assert full.startswith("2 statements: 1 reproduced, 1 contradicted. 1 erratum: 1 by reading.\n")
    assert full.endswith(
        "\n- **Fig 2**: It turns round x3. *вокруг* **Contradicted**: x1. Remark: not \\*so\\*."
    )
    rows = [line for table in tables for line in table.splitlines() if line.startswith("| ")]
    titles = [re.match(r"\w+", table)[0] for table in tables]
    assert titles == ["Errata", "Every", "What"]
    assert [row for row in rows if row.startswith(("| eq", "| Fig", "| hor"))] == [
        "| eq. 1 | + | - | by reading |  |",
        "| Fig 1 | It turns \\| round x\\_1. | reproduced | x1 | an axis other than x1 |",
        "| Fig 2 | It turns round x3. | contradicted | x1; not \\*so\\* | an axis other than x3 |",
        "| horizon | tau = 100 | turning |",
    ]


@pytest.mark.heyoka
def test_the_head_of_a_page_has_no_number_that_its_entries_do_not_give(paper: str) -> None:
    head, _, entries = (
        (ROOT / "docs" / f"{paper}.md")
        .read_text(encoding="utf-8")
        .partition(f"<!-- begin: {paper} -->")
    )
    measured = re.findall(r"\d+\.\d{3,}", " ".join(head.splitlines()[3:]))
    assert measured
    given = [float(x) for x in re.findall(r"\d+\.\d+", entries)]
    missing = [
        x for x in measured if not any(round(y, len(x.split(".")[1])) == float(x) for y in given)
    ]
    assert not missing
