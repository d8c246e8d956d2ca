"""Show the notebooks of `docs/notebooks` as pages of the site, with the outputs that they were saved with."""

import re
from pathlib import PurePosixPath
from typing import Any

import nbformat
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter


def on_files(files: Files, config: Any) -> Files:
    """Add a page and its pictures for each notebook; the notebook itself stays, to be downloaded."""
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        page = PurePosixPath(file.src_uri).with_suffix(".md")
        notebook = nbformat.read(file.abs_src_path, as_version=4)
        text, resources = MarkdownExporter().from_notebook_node(
            notebook, {"output_files_dir": f"{page.stem}_files", "unique_key": page.stem}
        )
        head, _, rest = text.lstrip().partition("\n")
        link = f'<a href="{page.stem}.ipynb" download>Download this notebook</a>'
        files.append(File.generated(config, str(page), content=f"{head}\n\n{link}\n{rest}"))
        for name, content in resources["outputs"].items():
            files.append(File.generated(config, str(page.parent / name), content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Let links to notebooks lead to their pages; in the repository they lead to the notebooks themselves."""
    return re.sub(r"(\]\([\w./-]+)\.ipynb(?=[)#])", r"\1.md", markdown)
