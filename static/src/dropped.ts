// Files that were dropped, on their way to the view that starts plans.
import { signal } from "@preact/signals";

export const dropped = signal<File[]>([]);
