"""The paper's evaluation in one command: published data sets in, Tables 2-5 out.

    folders of a data set ──► scenes ──► trainings ──► predictions ──► pooled errors ──► tables

- `datasets.py`: what a data set holds, and where its scenes are.
- `recipes.py`: how each network is trained, by paper and published code.
- `plan.py`, `importing.py`, `running.py`: the work, none of it done twice.
- `pooling.py`, `comparison.py`, `references.py`: figures beside the printed ones, which are in
  `data/paper_tables.json` and `data/reference_medians.json`.
- `report.py`: the same as Markdown and JSON.
- `demo.py`: what `vioapr demo` localizes, out of `data/`.
"""
