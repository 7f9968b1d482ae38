// A stage inside a view of the page: made when it is shown, given back when it is not, with its tools of view and picture.
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Box3 } from "three";
import { Stage, STANDARD_VIEWS } from "./stage";
import { text } from "./text";
import { Button } from "./widgets";

export function View3d({ label, onStage, box, name, children, tools }: {
  label: string; onStage: (stage: Stage | null) => void; box: () => Box3 | null; name: string; children?: ComponentChildren;
  tools?: ComponentChildren;
}) {
  const holder = useRef<HTMLDivElement>(null);
  const stage = useRef<Stage | null>(null);
  const [problem, setProblem] = useState("");
  useEffect(() => {
    try {
      stage.current = new Stage(holder.current!, `${label}. ${text.plan.keys}`);
      onStage(stage.current);
    } catch {
      setProblem(text.noWebgl);
    }
    return () => { onStage(null); stage.current?.dispose(); stage.current = null; };
  }, []);
  const look = (direction: [number, number, number]): void => {
    const all = box();
    if (all) stage.current?.look(all, direction);
  };
  return (
    <div class="view3d">
      <div class="toolbar" role="toolbar" aria-label={label}>
        {Object.entries(STANDARD_VIEWS).map(([name, direction]) => (
          <Button key={name} aria-label={`${text.plan.standardLabel}: ${text.plan.standard[name]}`} onClick={() => look(direction)}>
            {text.plan.standard[name]}
          </Button>
        ))}
        <Button onClick={() => { const all = box(); if (all) stage.current?.fit(all); }}>{text.plan.fit}</Button>
        {tools}
        <Button onClick={() => stage.current?.screenshot(`${name}.png`)}>{text.plan.screenshot}</Button>
      </div>
      <div class="drawn3d">
        <div class="stage" ref={holder} data-name={name}>{problem && <p class="empty">{problem}</p>}</div>
        {children}
      </div>
    </div>
  );
}
