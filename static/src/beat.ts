// Renews a lease from a thread of its own: a browser slows the clock of a page that nobody sees, not that of its workers. Says
// when the server refuses; a server that does not answer is asked again.

export interface Beat { url: string; headers: Record<string, string>; everyMs: number }

const TOO_MANY = 429;

onmessage = ({ data: { url, headers, everyMs } }: MessageEvent<Beat>) => {
  const beat = async (): Promise<void> => {
    const answer = await fetch(url, { method: "PUT", headers }).catch(() => null);
    if (answer && answer.status >= 400 && answer.status < 500 && answer.status !== TOO_MANY) postMessage("lost");
  };
  setInterval(() => void beat(), everyMs);
  void beat();
};
