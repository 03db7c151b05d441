"""Diagnosis of a calibration, pictures or the installation, in plain words, with recommendations.

`findings.py` defines findings and their order; `calibration.py` derives them from a report, with the gains of
`remedies.py`; `pictures.py` from pictures, before any calibration; `installation.py` examines the installation.
"""

from camcal.report.doctor.findings import Finding, Gain, diagnosis

__all__ = ["Finding", "Gain", "diagnosis"]
