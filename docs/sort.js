/* A click on a heading sorts a long table by that column; another click turns it around. */
document.addEventListener("DOMContentLoaded", () => {
  for (const table of document.querySelectorAll("article table")) {
    const body = table.tBodies[0];
    if (!body || body.rows.length < 20) continue;
    [...table.querySelectorAll("th")].forEach((head, column) => {
      head.classList.add("sorts");
      head.addEventListener("click", () => {
        const turned = head.dataset.sorted === "up" ? -1 : 1;
        const text = (row) => row.cells[column].innerText;
        const rows = [...body.rows].sort(
          (a, b) => turned * text(a).localeCompare(text(b), undefined, { numeric: true })
        );
        head.dataset.sorted = turned === 1 ? "up" : "down";
        body.append(...rows);
      });
    });
  }
});
