// The search of every page: pages, slots and pupils, found by any words of theirs; Ctrl-K opens it. It is no modal window,
// so that STOP stays within reach. And the field that leaves only the cards with certain words on the page Robot.
(() => {  // a function declared in a bare block would take the place of the browser's own, such as `open`
  const MOST = 50;
  const dialog = document.getElementById("ms-find"), field = document.getElementById("ms-find-words");
  const list = document.getElementById("ms-find-list"), count = document.getElementById("ms-find-count");
  let entries = [], found = [], active = 0, cameFrom = null;

  const words = (text) => text.toLocaleLowerCase().split(/\s+/).filter(Boolean);
  const fits = (text, wanted) => wanted.every((word) => text.includes(word));

  function collect() {
    const pages = [...document.querySelectorAll(".ms-nav a")].map((link) => ({
      text: link.querySelector("[data-title]").textContent,
      of: link.closest("[data-group]")?.dataset.group || "",
      href: link.href,
    }));
    const more = JSON.parse(dialog.dataset.more).map(([text, of, path]) => ({ text, of, href: msbotAt(path) }));
    entries = [...pages, ...more].map((one) => ({ ...one, all: `${one.text} ${one.of}`.toLocaleLowerCase() }));
  }

  function show() {
    const wanted = words(field.value), all = entries.filter((one) => fits(one.all, wanted));
    found = all.slice(0, MOST);
    active = 0;
    list.replaceChildren(...found.map((one, number) => {
      const item = document.createElement("li");
      item.id = `ms-find-${number}`;
      item.setAttribute("role", "option");
      item.textContent = one.text;
      if (one.of) {
        const of = document.createElement("span");
        of.className = "soft";
        of.textContent = ` · ${one.of}`;
        item.append(of);
      }
      item.addEventListener("click", () => { location.href = one.href; });
      return item;
    }));
    count.textContent = all.length ? `${all.length}` : dialog.dataset.nothing;
    mark();
  }

  function mark() {
    [...list.children].forEach((item, number) => item.setAttribute("aria-selected", String(number === active)));
    const item = list.children[active];
    if (!item) return field.removeAttribute("aria-activedescendant");
    field.setAttribute("aria-activedescendant", item.id);
    item.scrollIntoView({ block: "nearest" });
  }

  function open(from) {
    if (dialog.open) return field.select();
    cameFrom = from;
    collect();
    dialog.show();
    field.value = "";
    show();
    field.focus();
  }

  function close() {
    if (!dialog.open) return;
    dialog.close();
    cameFrom?.focus();
    if (document.activeElement !== cameFrom) document.getElementById("ms-find-open").focus();
  }

  document.addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && !event.altKey && !event.shiftKey && event.key.toLowerCase() === "k") {
      event.preventDefault();
      event.stopPropagation();
      open(document.activeElement);
    }
  }, true);
  document.addEventListener("click", (event) => {
    const button = event.target.closest("#ms-find-open");
    if (button) open(button);
    else if (!event.target.closest("#ms-find") && dialog.open) dialog.close();
  });
  field.addEventListener("input", show);
  dialog.addEventListener("keydown", (event) => {
    const steps = { ArrowDown: 1, ArrowUp: -1 };
    if (event.key in steps && found.length) active = (active + steps[event.key] + found.length) % found.length;
    else if (event.key === "Enter" && found[active]) location.href = found[active].href;
    else if (event.key === "Escape") close();
    else return;
    event.preventDefault();
    mark();
  });

  // Cards
  function leave() {
    const input = document.getElementById("ms-cards-words");
    if (!input) return;
    const wanted = words(input.value), cards = [...document.querySelectorAll(".ms-cards .place")];
    let shown = 0;
    for (const card of cards) {
      const is = fits(`${card.textContent} ${card.dataset.words}`.toLocaleLowerCase(), wanted);
      if (card.hidden === is) card.hidden = !is;
      shown += is;
    }
    for (const box of document.querySelectorAll(".ms-cards details")) {
      if (wanted.length && box.querySelector(".place:not([hidden])")) box.open = true;
    }
    const said = wanted.length ? `${shown} / ${cards.length}` : "";
    const place = document.getElementById("ms-cards-count");
    if (place.textContent !== said) place.textContent = said;
  }
  document.addEventListener("input", (event) => { if (event.target.id === "ms-cards-words") leave(); });
  new MutationObserver((changes) => {
    const input = document.getElementById("ms-cards-words");
    if (input?.value && changes.some((one) => one.target.closest?.(".ms-cards"))) leave();
  }).observe(document.body, { childList: true, subtree: true });
})();
