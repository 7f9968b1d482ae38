// Start of a run in simulation: of which setup, how fast its clock goes, where it begins.
import { useSignal } from "@preact/signals";
import { post, type Run } from "./api";
import { hrefOf } from "./settings";
import { text } from "./text";
import { Button, Dialog, goToMade, NumberInput, Select } from "./widgets";

const words = text.runs;
const DEMO_CLOCK = 5;

export function StartRun({ job, setups, kind, setup = 0, timeFactor = DEMO_CLOCK, fromStep = 0 }: {
  job: string; setups: number; kind?: string; setup?: number; timeFactor?: number; fromStep?: number;
}) {
  const isOpen = useSignal(false);
  const given = useSignal({ setup, time_factor: timeFactor, from_step: fromStep, single_step: false });
  const set = (change: Partial<typeof given.value>): void => { given.value = { ...given.value, ...change }; };
  const open = (): void => {
    given.value = { ...given.value, setup, time_factor: timeFactor, from_step: fromStep };
    isOpen.value = true;
  };
  const start = (): Promise<void> => goToMade(async () => {
    const run = await post<Run>("/runs", { job_id: job, mode: "simulate", ...given.value });
    isOpen.value = false;
    return hrefOf(["runs", run.id]);
  });
  const number = (label: string, key: "time_factor" | "from_step", min: number, max: number) => (
    <label><span>{label}</span><NumberInput name={key} min={min} max={max} value={given.value[key]} onNumber={(value) => set({ [key]: value ?? min })} /></label>
  );
  return (
    <>
      <Button kind={kind ?? ""} onClick={open}>{text.job.run}</Button>
      {isOpen.value && (
        <Dialog title={words.start} onClose={() => { isOpen.value = false; }}>
          {setups > 1 && (
            <Select label={text.cell.setupLabel} name="setup" value={String(given.value.setup)} onChange={(at) => set({ setup: Number(at), from_step: 0 })}
              options={Array.from({ length: setups }, (_, i) => [String(i), String(i + 1)])} />
          )}
          {number(words.timeFactor, "time_factor", 1, 100)}
          {number(words.fromStep, "from_step", 0, 1e6)}
          <label class="check"><input type="checkbox" name="single_step" checked={given.value.single_step} onChange={(event) => set({ single_step: event.currentTarget.checked })} />{words.singleStep}</label>
          <p class="actions"><Button kind="primary" onClick={start}>{text.job.run}</Button><Button onClick={() => { isOpen.value = false; }}>{text.jobs.cancel}</Button></p>
        </Dialog>
      )}
    </>
  );
}
