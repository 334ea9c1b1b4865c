// The live page: answers of the form, and a run that grows.

const EVERY = 1000; // between two looks at a run [ms]

function startLive(told) {
  const live = new Live(told);
  const page = {};
  const show = (data, keep) => Object.assign(page, showDocument(data, keep));
  show(told);
  const submit = async (question) => {
    const data = await live.fetch("/api/decide", question);
    if (page.following) page.following.stop();
    show(data, state.pinned ? { pair: state.pair, pinned: true } : {});
  };
  const before = document.getElementById("main");
  const form = askForm(live, submit);
  if (live.follows) {
    page.following = new Following(live, page, show);
    before.before(page.following.node);
    before.before(
      el(
        "details",
        { class: "ask-fold" },
        el("summary", null, "Decide a scenario of your own"),
        form,
      ),
    );
    page.following.start();
  } else {
    before.before(form);
    form.requestSubmit();
  }
  return page;
}

class Following {
  constructor(live, page, show) {
    Object.assign(this, { live, page, show, name: "", known: 0, whole: false });
    this.select = el("select", { id: "episode", onchange: () => this.choose(this.select.value) });
    this.status = el("span", { class: "faint small" }, "looking …");
    this.edge = el("input", { type: "checkbox", checked: true, id: "edge" });
    this.node = el(
      "div",
      { class: "card following", id: "following" },
      el("label", { for: "episode" }, "Episode"),
      this.select,
      el("label", { for: "edge" }, this.edge, " stay at the newest decision"),
      this.status,
    );
  }

  start() {
    this.running = true;
    this.look();
  }

  stop() {
    this.running = false;
    clearTimeout(this.timer);
    this.status.textContent = "not followed: a decision of your own is shown";
  }

  choose(name) {
    this.name = name;
    this.known = 0;
    this.whole = false;
    clearTimeout(this.timer);
    this.start();
  }

  async look() {
    try {
      const known = this.whole ? "all" : String(this.known);
      const query = new URLSearchParams({ episode: this.name, known });
      this.take(await this.live.fetch(`/api/run?${query}`));
    } catch (problem) {
      this.status.textContent = problem.message;
    }
    clearTimeout(this.timer);
    if (this.running) this.timer = setTimeout(() => this.look(), EVERY);
  }

  take(news) {
    if (!this.running) return;
    const names = news.episodes.map((episode) => episode.name);
    if (names.join() !== [...this.select.options].map((option) => option.value).join()) {
      replaceIn(
        this.select,
        names.map((name) => el("option", { value: name }, name)),
      );
    }
    if (!news.episode_name) {
      this.status.textContent = "no decision has been made yet";
      return;
    }
    const begun = news.episodes.find((episode) => !episode.done && episode.name !== this.name);
    if (this.whole && this.edge.checked && begun) {
      // The one that was followed is complete, and the next one is under way.
      Object.assign(this, { name: begun.name, known: 0, whole: false });
      return;
    }
    this.select.value = this.name = news.episode_name;
    if (news.done === undefined) return;
    this.whole = news.done;
    if (news.document) this.first(news.document);
    else if (news.decisions?.length) this.more(news);
    this.status.textContent = news.done ? "complete" : `under way, ${this.known} decisions`;
  }

  first(data) {
    const kept =
      this.known > 0 && this.page.model
        ? { time: state.time, pair: state.pinned ? state.pair : null, pinned: state.pinned }
        : {};
    this.known = data.decisions.length;
    this.show(data);
    const { model } = this.page;
    if (!model) return;
    if (kept.pinned) Object.assign(state, { pair: kept.pair, pinned: true });
    if (kept.time !== undefined && !this.edge.checked) goTo(model, kept.time);
    else if (!this.whole) goTo(model, model.duration);
  }

  more(news) {
    const { model } = this.page;
    model.extend(news);
    this.known = model.decisions.length;
    document.getElementById("timeline")?.replaceWith(episodeCard(model));
    document.getElementById("all-decisions")?.replaceChildren(decisionTable(model));
    if (this.edge.checked && !state.playing) goTo(model, model.duration);
    change({ ahead: this.edge.checked ? 0 : state.ahead, grown: this.known });
  }
}
