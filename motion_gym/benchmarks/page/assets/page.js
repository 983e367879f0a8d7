"use strict";
// What is shown follows the address: #scenes?scene=3&step=9, #leaderboard?benchmark=style&q=modular, #style.
(async () => {
  // A browser without this class shows all tables, as one without scripts does.
  if (!("DecompressionStream" in window)) return;
  const bytes = Uint8Array.from(atob(document.getElementById("data").textContent), (letter) => letter.charCodeAt(0));
  const data = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).json();
  document.documentElement.classList.add("scripted");
  const views = [...document.querySelectorAll(".view")];
  const fallback = data.scenes.length ? "scenes" : "leaderboard";
  if (!data.scenes.length) { document.getElementById("scenes").remove(); document.querySelector('nav a[href="#scenes"]').parentElement.remove(); }

  const parse = () => {
    const [name, query] = location.hash.slice(1).split("?");
    const known = views.some((view) => view.id === name && view.isConnected);
    return [known ? name : fallback, known ? Object.fromEntries(new URLSearchParams(query)) : {}];
  };
  const address = (name, state) => {
    const query = new URLSearchParams(Object.entries(state).filter(([key, value]) => value !== undefined && (value !== "" || key === "benchmark"))).toString();
    return `#${name}${query ? "?" + query : ""}`;
  };
  const remember = (name) => (state) => { history.replaceState(null, "", address(name, state)); if (name === "leaderboard") Board.show(state); };

  Board.setUp(data.board, data.colors, remember("leaderboard"));
  if (data.scenes.length) Player.setUp(document.getElementById("player"), data.scenes, data.colors, remember("scenes"));
  Charts.setUp(data.charts);
  document.querySelectorAll("main section:not(#leaderboard) .sortable thead th").forEach(Board.makeSortable);

  function route() {
    const [name, state] = parse();
    for (const view of views) view.classList.toggle("shown", view.id === name);
    document.querySelectorAll("nav a").forEach((link) => { if (link.hash === `#${name}`) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current"); });
    if (name === "leaderboard") Board.show(state);
    if (data.scenes.length) { if (name === "scenes") Player.show(state); else Player.pause(); }
  }
  addEventListener("hashchange", () => { route(); scrollTo(0, 0); });
  route();
  requestAnimationFrame(() => scrollTo(0, 0));
})();
