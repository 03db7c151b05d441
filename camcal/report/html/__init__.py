"""A report as one self-contained page that needs no network, with layouts for phones, dark mode and print."""
