// Server-sent events, read by fetch: a dropped connection is taken up after the last event that was handled, an event that
// comes twice is handled once, and an answer that is no stream is tried again. The browser's own EventSource can begin anew
// only from now on, and loses what happened while it was away.
import { signal } from "@preact/signals";
import { request, Refused } from "./api";

export type Connection = "connecting" | "live" | "lost";

export interface LiveEvent { id: string; kind: string; data: unknown }

interface Options {
  path: string;
  onEvent: (event: LiveEvent) => void;
  /** The server no longer has the events after the last one seen, or there was none: what is shown is to be read anew. */
  onReset: () => void;
  /** True where ids are numbers that rise, so that doubled events are known. */
  numbered: boolean;
}

const FIRST_DELAY_MS = 500;
const MAX_DELAY_MS = 10_000;
/** A comment comes every 15 s; longer silence is a dead connection that nobody closed. */
const SILENCE_MS = 40_000;

/** The streams of this page. A browser has six connections to a server for all its pages; a stream holds one of them. */
const streams = new Set<Stream>();
/** Gives the connections of the streams to requests that wait for one; the streams are taken up again a moment later. */
export const giveWay = (): void => streams.forEach((stream) => stream.rest());
// Nobody looks at a hidden page.
document.addEventListener("visibilitychange", () => (document.hidden ? giveWay() : streams.forEach((stream) => stream.hurry())));

/** A stream of events that lives until it is closed. */
export class Stream {
  readonly connection = signal<Connection>("connecting");
  private last = "";
  private isOver = false;
  private controller = new AbortController();
  private delay = FIRST_DELAY_MS;

  constructor(private readonly options: Options) {
    void this.run();
    streams.add(this);
    addEventListener("online", this.hurry);
  }

  close(): void {
    this.isOver = true;
    this.controller.abort();
    streams.delete(this);
    removeEventListener("online", this.hurry);
  }

  /** Closes the connection until the page is seen, or for a moment. */
  rest(): void {
    this.connection.value = "connecting";
    this.controller.abort();
  }

  readonly hurry = (): void => { this.delay = FIRST_DELAY_MS; this.wake(); };
  private wake: () => void = () => {};

  private async run(): Promise<void> {
    let isFirst = true;
    while (!this.isOver) {
      if (document.hidden) { await this.pause(); continue; }
      try {
        this.controller = new AbortController();
        const headers: Record<string, string> = { Accept: "text/event-stream" };
        if (this.last) headers["Last-Event-ID"] = this.last;
        const response = await request(this.options.path, { headers, signal: this.controller.signal });
        if (response.status === 204) return;
        this.connection.value = "live";
        this.delay = FIRST_DELAY_MS;
        // Without an id to go on from, what happened before this stream is read from the lists.
        if (isFirst || !this.last) this.options.onReset();
        isFirst = false;
        await this.read(response);
      } catch (error) {
        if (this.isOver) return;
        if (error instanceof Refused && error.status === 404) return;
      }
      if (this.isOver) return;
      if (!this.controller.signal.aborted) this.connection.value = "lost";
      await this.pause();
    }
  }

  private pause(): Promise<void> {
    const delay = this.delay * (0.75 + 0.5 * Math.random());
    this.delay = Math.min(2 * this.delay, MAX_DELAY_MS);
    return new Promise((resolve) => {
      const timer = setTimeout(resolve, delay);
      this.wake = () => { clearTimeout(timer); resolve(); };
    });
  }

  private async read(response: Response): Promise<void> {
    const reader = response.body!.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const silence = setTimeout(() => { this.connection.value = "lost"; this.controller.abort(); }, SILENCE_MS);
      const { value, done } = await reader.read().finally(() => clearTimeout(silence));
      if (done) return;
      const parts = (rest + value).split(/\r?\n\r?\n/);
      rest = parts.pop() ?? "";
      parts.forEach((part) => this.handle(part));
    }
  }

  private handle(text: string): void {
    const fields: Record<string, string> = {};
    for (const line of text.split(/\r?\n/)) {
      const [, name, value] = /^(\w+): ?(.*)$/.exec(line) ?? [];
      if (name) fields[name] = name === "data" && fields.data !== undefined ? `${fields.data}\n${value}` : value!;
    }
    const kind = fields.event;
    if (!kind) return;
    if (kind === "reset") {
      // Where it has an id nothing follows: whoever comes back with that is told so.
      if (fields.id) this.last = fields.id;
      return this.options.onReset();
    }
    if (fields.id) {
      if (this.options.numbered && this.last && Number(fields.id) <= Number(this.last)) return;
      this.last = fields.id;
    }
    this.options.onEvent({ id: fields.id ?? "", kind, data: JSON.parse(fields.data ?? "null") });
  }
}
