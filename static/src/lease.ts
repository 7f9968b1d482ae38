// The lease of a cell that this page holds; it lives as long as the page renews it.
import { signal } from "@preact/signals";
import { apiPath, asPage, post, remove } from "./api";
import type { Beat } from "./beat";
import { text } from "./text";
import { message } from "./widgets";

interface Lease { id: string; token: number; heartbeat_ms: number; ttl_ms: number; cell: string; holder: string }
export const lease = signal<Lease | null>(null);
let beating: Worker | null = null;

/** Asks the reader before the page is left, which would end the lease and stop a run. */
const warn = (event: BeforeUnloadEvent): void => event.preventDefault();

function letGo(): void {
  beating?.terminate();
  beating = null;
  lease.value = null;
  removeEventListener("beforeunload", warn);
}

export async function takeLease(cell: string, holder: string): Promise<void> {
  const taken = await post<Lease>("/leases", { cell, holder });
  letGo();
  lease.value = taken;
  beating = new Worker(new URL("./beat.js", import.meta.url), { type: "module" });
  beating.onmessage = () => { letGo(); message.value = text.runs.leaseGone; };
  // A request without an answer by then leaves time for another one before the lease ends.
  beating.postMessage({ url: `${apiPath}/leases/${taken.id}`, headers: asPage, everyMs: taken.heartbeat_ms, withinMs: taken.ttl_ms / 2 } satisfies Beat);
  addEventListener("beforeunload", warn);
}

export async function giveBack(): Promise<void> {
  const held = lease.peek();
  letGo();
  if (held) await remove(`/leases/${held.id}`);
}

export const withToken = (path: string): string => (lease.peek() ? `${path}?token=${lease.peek()!.token}` : path);
