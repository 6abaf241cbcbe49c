"""Computes tests/regression_vectors.json with scikit-learn: the reference of the tests of src/discriminant/regressor.rs.

Run in an environment with scikit-learn 1.9.1 and numpy (`./proact peers` makes one, build/peers):
    build/peers/bin/python rust/emg/tests/make_regression_vectors.py > rust/emg/tests/regression_vectors.json
The windows are made here, from a fixed seed: the five gestures, eight features on unlike scales, of which one is constant and
one is twice another. Targets are LibEMG's discrete ones: two degrees of freedom, 1 and -1 for their gestures, else 0.
"""

import json

import numpy as np
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.metrics import mean_absolute_error, r2_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

rng = np.random.default_rng(20261126)
# hand_close, hand_open, no_motion, wrist_extension, wrist_flexion: wrist, then hand.
TARGETS = np.array([[0, -1], [0, 1], [0, 0], [1, 0], [-1, 0]], dtype=float)
CLASSES, FEATURES = len(TARGETS), 6
centres = rng.normal(0, 1.6, (CLASSES, FEATURES))
scales = np.array([0.5, 1.0, 40.0, 1.0, 5.0, 0.3])


def draw(counts):
    rows = [(centres[c] + rng.normal(0, 0.8, (n, FEATURES))) * scales for c, n in enumerate(counts)]
    rows = np.array([[float(f"{v:.6g}") for v in row] for row in np.concatenate(rows)])
    rows = np.column_stack([rows, np.full(len(rows), 7.0), 2.0 * rows[:, 1]])
    return rows, np.repeat(np.arange(CLASSES), counts)


train, labels = draw([30, 40, 25, 35, 28])
test, truth = draw([20, 20, 20, 20, 20])
out = {"train": train.tolist(), "labels": labels.tolist(), "test": test.tolist(), "truth": truth.tolist(), "models": []}
for alpha in [0.0, 1.0, 25.0]:
    # The least-squares solution of least norm does not depend on how the constant feature is scaled.
    model = make_pipeline(StandardScaler(), Ridge(alpha=alpha) if alpha else LinearRegression())
    predicted = model.fit(train, TARGETS[labels]).predict(test)
    out["models"].append(
        {
            "alpha": alpha,
            "drives": predicted.tolist(),
            "r2": r2_score(TARGETS[truth], np.clip(predicted, -1, 1), multioutput="raw_values").tolist(),
            "mae": mean_absolute_error(TARGETS[truth], np.clip(predicted, -1, 1), multioutput="raw_values").tolist(),
        }
    )
print(json.dumps(out))
