"use strict";
/* Shows one page at a time, draws its figures when they can be seen, and follows light, dark and print. */
(() => {
  const darkOfLight = JSON.parse(document.getElementById("dark-of-light").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const config = {
    displaylogo: false,
    responsive: true,
    doubleClick: "reset",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
    toImageButtonOptions: { format: "svg", scale: 1 },
  };

  function coloured(value, isDark) {
    if (!isDark) return value;
    if (typeof value === "string") return darkOfLight[value] || value;
    const number = (item) => typeof item === "number";
    if (Array.isArray(value)) return value.length && number(value[0]) && number(value.at(-1)) ? value : value.map((item) => coloured(item, true));
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item, true)]));
    }
    return value;
  }

  function draw(box, isDark = dark.matches) {
    const wanted = isDark ? "dark" : "light";
    if (box.dataset.drawn === wanted) return Promise.resolve();
    box.dataset.drawn = wanted;
    const text = box.parentElement.querySelector("script").textContent;
    const spec = coloured(JSON.parse(text), isDark);
    return Plotly.react(box, spec.data, spec.layout, config);
  }

  const visible = (box) => box.offsetParent !== null && !box.closest("details:not([open])");
  const figures = (root) => [...root.querySelectorAll(".figure")];

  async function drawSeen(root) {
    for (const box of figures(root)) {
      if (visible(box)) await draw(box);
    }
    document.body.dataset.ready = root.id || "part";
  }

  function show() {
    const target = document.getElementById(location.hash.slice(1) || document.body.dataset.shown);
    const page = (target && target.closest(".page")) || document.getElementById(document.body.dataset.shown);
    if (!page) return;
    for (const other of document.querySelectorAll(".page")) other.classList.toggle("current", other === page);
    for (const link of document.querySelectorAll("[data-page]")) {
      link.classList.toggle("current", link.dataset.page === page.id);
    }
    document.title = page.dataset.title + " – ident";
    if (target && target !== page) target.scrollIntoView();
    else scrollTo(0, 0);
    drawSeen(page);
  }

  document.documentElement.classList.add("js");
  for (const details of document.querySelectorAll("details")) {
    details.addEventListener("toggle", () => details.open && drawSeen(details));
  }
  addEventListener("hashchange", show);
  dark.addEventListener("change", () => drawSeen(document.querySelector(".page.current")));
  addEventListener("beforeprint", () => {
    for (const details of document.querySelectorAll(".page.current details")) details.open = true;
    for (const box of figures(document.querySelector(".page.current"))) draw(box, false);
  });
  addEventListener("afterprint", () => drawSeen(document.querySelector(".page.current")));
  show();
})();
