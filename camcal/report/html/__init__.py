"""A report as one self-contained page: no network, readable on a phone, in the dark and on paper."""
