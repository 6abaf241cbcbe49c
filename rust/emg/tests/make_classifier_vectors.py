"""Computes tests/classifier_vectors.json with scikit-learn: the reference of the tests of src/discriminant.rs.

Run in an environment with scikit-learn 1.9.1 and numpy:
    python make_classifier_vectors.py > classifier_vectors.json
The windows are made here, from a fixed seed: four classes of six features on unlike scales, which overlap.
"""

import json

import numpy as np
from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

rng = np.random.default_rng(20261125)
CLASSES, FEATURES = 4, 6
centres = rng.normal(0, 1.6, (CLASSES, FEATURES))
mixes = rng.normal(0, 0.6, (CLASSES, FEATURES, FEATURES)) + np.eye(FEATURES)
scales = np.array([0.5, 1.0, 40.0, 1.0, 5.0, 0.3])


def draw(counts):
    rows = [(centres[c] + rng.normal(0, 1, (n, FEATURES)) @ mixes[c]) * scales for c, n in enumerate(counts)]
    labels = np.repeat(np.arange(CLASSES), counts)
    # The same numbers on both sides.
    return np.array([[float(f"{v:.6g}") for v in row] for row in np.concatenate(rows)]), labels


train, labels = draw([30, 40, 25, 35])
test, truth = draw([20, 20, 20, 20])
out = {"train": train.tolist(), "labels": labels.tolist(), "test": test.tolist(), "truth": truth.tolist()}
qda = QuadraticDiscriminantAnalysis().fit(train, labels)
out["qda"] = {"decisions": qda.decision_function(test).tolist(), "posterior": qda.predict_proba(test).tolist()}
out["nb"] = {"posterior": GaussianNB().fit(train, labels).predict_proba(test).tolist()}
knn = make_pipeline(StandardScaler(), KNeighborsClassifier(n_neighbors=5)).fit(train, labels)
out["knn"] = {"posterior": knn.predict_proba(test).tolist()}
svm = make_pipeline(
    StandardScaler(), SVC(kernel="linear", tol=1e-9, decision_function_shape="ovo", probability=True, random_state=0)
).fit(train, labels)
out["svm"] = {"decisions": svm.decision_function(test).tolist(), "posterior": svm.predict_proba(test).tolist()}
right = [
    float(np.mean(RandomForestClassifier(random_state=seed).fit(train, labels).predict(test) == truth))
    for seed in range(20)
]
out["rf"] = {"least": min(right), "most": max(right)}
print(json.dumps(out))
