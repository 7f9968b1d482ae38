// Renews a lease from a thread of its own: a browser slows the clock of a page that nobody sees, not that of its workers. Says
// when the server refuses; a server that does not answer is asked again.

export interface Beat { url: string; headers: Record<string, string>; everyMs: number; withinMs: number }

const TOO_MANY = 429;

onmessage = async ({ data: { url, headers, everyMs, withinMs } }: MessageEvent<Beat>) => {
  for (;;) {
    // Requests to a server that stalls do not pile up: the next waits for the end of this one.
    const due = new Promise((next) => { setTimeout(next, everyMs); });
    const answer = await fetch(url, { method: "PUT", headers, signal: AbortSignal.timeout(withinMs) }).catch(() => null);
    if (answer && answer.status >= 400 && answer.status < 500 && answer.status !== TOO_MANY) postMessage("lost");
    await due;
  }
};
