"""The paper's evaluation in one command, and the demo: functions that return configurations.

    folders of a data set ──► scenes ──► trainings ──► predictions ──► pooled errors ──► tables

- `reproduce.py`: the whole way; begin here.
- `datasets.py`: the scenes of a data set, found and imported.
- `paper.py`: how each network is trained, by paper and published code.
- `trainings.py`, `running.py`: the work that is left, and doing it; none of it twice.
- `pooling.py`, `comparison.py`: our errors, and figures beside the printed ones, which are in
  `data/paper_tables.json` and `data/reference_medians.json`.
- `report.py`: the same as text, Markdown and JSON.
- `demo.py`: the walk that `vioapr demo` localizes, out of `data/`.
"""
