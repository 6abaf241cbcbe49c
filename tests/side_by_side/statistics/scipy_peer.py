#!/usr/bin/python3
"""Statistics of data sets by SciPy and statsmodels: JSON lines in, JSON lines out, one a data set.

In: {"rows": [[..]], "chances": [..]}, values null where missing. Out: what the peers say, null where they cannot say it.
Chances that SciPy does not count out (ties, Friedman) are counted here, case by case, where there are few.
"""

import itertools
import json
import math
import sys
import warnings

import numpy
import scipy.stats
import statsmodels.stats.multitest

MAX_CASES = 60_000


def friedman(rows):
    conditions = len(rows[0]) if rows else 0
    if len(rows) < 2 or conditions < 3 or all(len(set(row)) == 1 for row in rows):
        return None
    result = scipy.stats.friedmanchisquare(*zip(*rows))
    ranks = [scipy.stats.rankdata(row) for row in rows]
    observed = sum(numpy.sum(ranks, axis=0) ** 2)
    counted = None
    # The first person's order may be held fixed: what the others do relative to it is what counts.
    if math.factorial(conditions) ** (len(rows) - 1) <= MAX_CASES:
        orders = [list(itertools.permutations(row)) for row in ranks[1:]]
        cases = [sum(numpy.sum([ranks[0], *case], axis=0) ** 2) >= observed - 1e-9 for case in itertools.product(*orders)]
        counted = sum(cases) / len(cases)
    return {"statistic": result.statistic, "p": result.pvalue, "exact": counted}


def paired(differences):
    differences = numpy.array(differences)
    other = differences[differences != 0]
    found = {"wilcoxon": None, "permutation": None, "skewness": None, "bca": None}
    if len(other):
        signs = other > 0
        ranks = scipy.stats.rankdata(abs(other))
        plus = sum(ranks[signs])
        found["wilcoxon"] = {"plus": plus, "minus": sum(ranks[~signs]), "p": None, "approximate": None}
        if len(other) <= 12:
            # Half sums of ranks are whole numbers of quarters: no rounding.
            sums = numpy.array([sum(r for r, s in zip(ranks, case) if s) for case in itertools.product([0, 1], repeat=len(ranks))])
            found["wilcoxon"]["p"] = min(1.0, 2 * min(numpy.mean(sums <= plus), numpy.mean(sums >= plus)))
        elif len(set(abs(other))) == len(other) and len(other) <= 50:
            found["wilcoxon"]["p"] = scipy.stats.wilcoxon(other, mode="exact").pvalue
        else:
            found["wilcoxon"]["approximate"] = scipy.stats.wilcoxon(other, mode="approx", correction=False).pvalue
    if 2 <= len(differences) <= 12:
        found["permutation"] = scipy.stats.permutation_test(
            (differences,), numpy.mean, permutation_type="samples", n_resamples=numpy.inf
        ).pvalue
    if len(differences) >= 8 and numpy.std(differences) > 0:
        found["skewness"] = [scipy.stats.skew(differences), scipy.stats.skewtest(differences).pvalue]
    if len(differences) >= 3 and numpy.std(differences) > 0:
        # Rounded, so that the same values drawn in another order are the same mean.
        mean = lambda values: round(float(numpy.mean(values)), 12)
        result = scipy.stats.bootstrap((differences,), mean, method="BCa", n_resamples=500, random_state=1, vectorized=False)
        found["bca"] = {
            "draws": list(result.bootstrap_distribution),
            "low": result.confidence_interval.low,
            "high": result.confidence_interval.high,
        }
    return found


warnings.simplefilter("ignore")
for line in sys.stdin:
    data = json.loads(line)
    rows = data["rows"]
    complete = [row for row in rows if None not in row]
    pairs = [[row[1] - row[0] for row in rows if row[0] is not None and row[1] is not None]]
    answer = {
        "friedman": friedman(complete),
        "paired": paired(pairs[0]),
        "holm": list(statsmodels.stats.multitest.multipletests(data["chances"], method="holm")[1]),
    }
    print(json.dumps(answer, default=float))
