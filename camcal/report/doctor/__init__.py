"""Diagnosis of a calibration, pictures or the installation, in plain words, with recommendations.

`findings.py` says what a finding is and in which order they stand; `calibration.py` finds them in a report,
with the gains of `remedies.py`; `pictures.py` in pictures, before any calibration; `installation.py` looks at
what camcal runs on.
"""

from camcal.report.doctor.findings import Finding, Gain, diagnosis

__all__ = ["Finding", "Gain", "diagnosis"]
