"""Units measured on one head, as a linear mixed model.

Unit u has the white residual z_u of its nominal model (noise N(0, I)) and the candidate columns X_u in that residual space:

    z_u = X_u (beta + b_u) + C_u gamma_u + e_u,    b_u ~ N(0, tau^2 I)

- beta, fixed effects: errors of the head, with one coefficient for all units. Of a set of candidates they have the prior of
  `evidence`.
- b_u, random effects: deviations of the units, of few effects. The variance component tau^2 (in the scales of the model, equal
  in all directions) is log-uniform on a grid; the mean is zero, or a further fixed effect.
- gamma_u: causes of unit u alone, a set C_u from its own list, with the prior of a single diagnosis.

A unit enters by its normal equations G = X' M X, g = X' M z, where M projects C_u out (`mixed_model.NormalEquations`). By
Woodbury's identity the random effects on columns c add -1/2 log|I + tau^2 G_cc| + 1/2 g_c' (I / tau^2 + G_cc)^-1 g_c to the log
evidence and leave G - G_.c (I / tau^2 + G_cc)^-1 G_c. (Lindley and Smith 1972). Their sums over the units are the normal
equations of beta, whose sets are searched as those of one file. The residual (restricted) likelihood of tau integrates a mean
with a flat prior out (Patterson and Thompson 1971). Differences between units are tested by Cochran's Q (1954).

Files: `unit` (data of the units), `mixed_model` (evidence), `hypotheses` and `search` (shared errors), `amounts` (amount of an
effect in every unit, two levels, pitch settings), `head_fit` (the measured head), `joint` (the diagnosis), `record` (its
numbers). Rules outside the model: fewer than a third of the units may be excluded, because they deviate
(`head_fit.most_excluded`); effects whose coefficients no head has are excluded, and the search is repeated
(`joint.joint_diagnosis`).
"""

from tumblecal.diagnosis.units.joint import JointDiagnosis as JointDiagnosis
from tumblecal.diagnosis.units.joint import joint_diagnosis as joint_diagnosis
