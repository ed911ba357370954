"""A user's script: diagnoses with an effect of one's own, in several processes."""

import pickle

import numpy as np

import tumblecal
from tumblecal import InputError
from tumblecal.effects import Effect, output_effect


tumblecal.enable_float64()
fourth: Effect = output_effect(
    "fourth_order.y", "y", lambda u, where: u[1] ** 4, unit="mg/g^4", typical=0.2, physics="K4 u^4", cause="Mine."
)
rig = tumblecal.read_rig("hidden_effect")
sets = [tumblecal.simulate(rig, seed=seed, noise_sd=0.1e-3) for seed in (4, 5)]
diagnosis = tumblecal.diagnose(sets[0], [fourth], noise_sd=0.1e-3)
again = pickle.loads(pickle.dumps(diagnosis))
assert again.labels == diagnosis.labels and np.array_equal(again.extended.values, diagnosis.extended.values)
print(diagnosis.verdict, diagnosis.labels, diagnosis.gain.cv_rms_after_g, diagnosis.best.probability)
for result in tumblecal.diagnose_many(sets, [fourth], noise_sd=0.1e-3):
    print(result.faults if isinstance(result, InputError) else result.verdict)
plan = tumblecal.next_plan(diagnosis)
print(plan.positions, plan.value)
