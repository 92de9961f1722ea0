"""Pages and figures: what people look at.

- `evaluation_report`, `map_report`: the pages; `page` and `templates/` make HTML of their data.
- `figures/`: one module a figure; `style`: how all of them look, and saving them.
- `scene_preview`: pictures and routes of a scene.
- `formatting`: figures as text, the same in the terminal's tables and on the pages.
"""
